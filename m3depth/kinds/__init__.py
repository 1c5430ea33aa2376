"""The kinds of network that train, score and drive here: M3Depth and its rivals, by the name in a weights file.

config.py      the sizes: presets by name, and the JSON form that names the kind; loads no torch
networks.py    the networks: a new one of some sizes, or a trained one from its file
"""
