"""What m3depth.rectify does, step by step: read a raw pair, choose rectified views, match rows, resample, report.

raw_image.py, products.py, product_names.py     images and products of missions; the right one of a left one
matches.py, row_errors.py               matched points, how far their rows lie apart, and what takes that out
pair.py                                 the whole way, as a function
options.py, checked.py                  the flags, and the way as they say, with its checks
files.py, figure.py                     the files that the command writes
"""
