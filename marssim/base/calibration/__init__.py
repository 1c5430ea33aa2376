"""Calibrations of stereo cameras: lens models, and readers and writers of calibration files.

lenses/            lens models: pinhole with distortion, fisheye, CAHV, CAHVOR and CAHVORE
cameras.py         a camera is a lens with a pose; two of them are a pair as it was built, not rectified
orientation.py     the common orientation that rectifies a pair
read_pair.py       reads a calibration of a raw pair, of any kind
opencv_file.py, camera_info.py, kalibr.py         calibrations of OpenCV, ROS and Kalibr, also written
product_label.py, pds3_label.py, pds4_label.py, zhurong.py    labels of rovers' images, with their camera models
rectified.py       reads calibrations of rectified pairs
rig_file.py        rigs for the simulator: lenses, vergence and rotations, or a calibration of a raw pair
calibration_files.py        writes the calibration of such a rig in every form that holds its lenses
bounded_text.py, fields.py         parsers for untrusted files, and checks of their numbers
"""
