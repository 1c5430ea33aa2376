"""M3Depth's network, one part a file, in the order of the data's way (paper, Sec. IV).

    model.py             M3Depth: a stereo pair -> Prediction (`infer`), tensors -> StereoOutput (`forward`)
    inference.py         the sizes at which a pair is worked on, and the network's maps as a Prediction
    output.py            StereoOutput, the Start of a larger pair, and the disparity after each step
    backbone.py          features of both images at 1/2, 1/4 and 1/8 of their size; convolutions of wavelet.py
    cost_volume.py       matching scores of 24 disparities at 1/8; soft argmin gives the first disparity map
    normal_branch.py     SNNet: the first normals, from the same volume
    refinement.py        ConvGRU: corrects disparity and normals T times at 1/4 and brings them to full size; on larger
                         images it goes on where a reduced pair ended
    fine_correction.py   corrects disparity, normals, confidence and sky once more, at 1/2

config.py holds every size and the presets `lite` and `paper`, geometry.py the formulas on tensors, device.py the choice
of processor and precision, checkpointing.py a way to save memory, row_bands.py one to
save time on large maps, and stereo_network.py what M3Depth shares with the other networks that train here.
"""
