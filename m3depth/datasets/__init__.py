"""Datasets of any layout as sequences of stereo samples, by `open_pairs`.

    open.py          open_pairs: recognises the layout, finds the pairs of a split
    config.py        DataConfig: the flags of a reader, and which layout takes which
    benchmarks.py, oaisys.py, folders.py   one generator a layout: where its pairs lie
    pair_files.py    one pair: reads its files into a StereoSample
    image_files.py, maps.py, rigs.py           images, maps and cameras in files

To add a layout: write a generator `def name(root, rigs) -> Iterator[PairFiles]` beside the others; give it a name in
`Format` and its flags in `FLAGS` (config.py); enter it in `READERS`, and files that identify it in `SIGNS` (open.py).
A test in tests/m3depth/datasets/test_layouts.py writes a small tree and reads it back.
"""
