"""ROS 2 bags of a stereo rover, without ROS: written and read by `rosbags` (the extra `real`).

Frames follow REP 103 and REP 105. All lengths are in metres, all angles in radians, all stamps in nanoseconds:

map                    world: x east, y north, z up
odom                   world as the odometry has it
base_link              rover: x forward, y left, z up; its origin is on the ground under the middle of the rover
left_camera            an eye with the axes of the rover: x along the optical axis, y left, z up
left_camera_optical    the same eye with the axes of its image: x right, y down, z forward
right_camera, right_camera_optical   the other eye, at y = -baseline of left_camera

Each topic of `names` has one type. Cameras are described as sensor_msgs/CameraInfo and REP 104 say, with P[0, 3] = -f B
in that of the right eye. Depth is an Image 32FC1 [m] as REP 118 says: NaN is unknown, inf is sky or too far.
"""
