"""Stereo pairs, predictions and classical matching, in NumPy and OpenCV.

    pairs.py          checks of a rectified pair, and the protocol of a sequence of samples
    prediction.py     Prediction: what every estimator returns
    classical.py      the classical methods: SGBM and BlockMatching
    window_costs.py   matching costs of windows and semi-global matching, compiled, for BlockMatching
    mc_cnn.py         MC-CNN of the package mccnn, with semi-global matching
    plane_normals.py  normals of planes that are fitted to a disparity map
    rows.py           rows of a pair that lie apart: estimated from the images, and taken out of the right one
    row_matches.py    the points that this estimate is from
    sky.py            what a network takes for sky and can be sky
    degradation.py    dust, bad focus, low light and a maladjusted rig, applied to a pair

To add a classical method, write a class with `infer(left, right, rig) -> Prediction` in classical.py;
`prediction_from_matches` fills holes and derives depth, normals and confidence. Commands take it at once as
`--estimator m3depth.stereo.classical:MyMatcher`. A short name is an entry of `Classical` and a case of `load_estimator`
in m3depth/estimator.py.
"""
