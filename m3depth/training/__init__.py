"""Training of M3Depth and its rivals, behind `python -m m3depth.train`. In the order of the data flow:

    samples.py, augmentation.py, packing.py   samples in memory, shuffled; crops of them, changed in look
    batch.py                                  crops -> Batch of tensors; their truth, also on coarser grids
    loop.py                                   train(): Batch -> network -> loss -> optimizer step, until the budget ends
    losses.py                                 the loss terms, with the weights of loss_config.py
    run.py                                    Run: network, averaged weights, optimizer, learning rate; checkpoint.pt
    validation.py, log.py, curves.py          scores on the val split; log.jsonl, the progress line and curves.png
    messages.py                               what a run prints: its start, its progress and its summary

config.py holds the flags, ending.py when a run ends, process_group.py the processes of torchrun. To add a loss term: a
weight in loss_config.py and a line in `total_loss` (losses.py).
"""
