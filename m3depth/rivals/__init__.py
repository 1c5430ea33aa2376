"""The methods that the paper compares M3Depth with, and a modern cheap one, built and trained here.

    raft_stereo.py         RAFT-Stereo
    selective_stereo.py    Selective-Stereo, on RAFT-Stereo
    hit_net.py             HITNet, with its losses in hit_net_loss.py
    cre_stereo.py          CREStereo
    uni_mvs_net.py         UniMVSNet
    light_stereo.py        LightStereo, the modern one
    fusion.py              Fusion, normals of a depth map
    geo_net.py             GeoNet, normals of a depth map

config.py holds the sizes of all and their presets, rival.py what they share, output.py what they return and how it is
trained, normal_network.py what the methods for normals share, layers.py parts of several of them, such as the encoders
of RAFT, recurrent.py what RAFT-Stereo and Selective-Stereo share.
"""
