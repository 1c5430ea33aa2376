"""The programs that run the network.

choice.py              which one: PyTorch, or OpenVINO (the extra `fast`) where it is installed and there is no GPU
openvino_network.py    the network run by OpenVINO, with the `infer` of M3Depth
graphs.py              the network as OpenVINO's graphs, and their precision
graph_files.py         graphs on disk, for the next process
"""
