"""envs.evaluate as on a processor without AVX-512, to be compared with the drives of this one.

    python tests/benchmarks/other_processor.py --suite marsnav-v1 --split dev --episodes 1 --no-videos --workers 1 \
        --perception ground_truth m3depth --out out/other

NumPy, OpenBLAS, PyTorch and the compiled loops do without AVX-512, and M3Depth's convolutions run in float32 instead of
bfloat16. OpenVINO and Embree still choose their instructions themselves.
"""

import os
import sys

os.environ |= {  # before NumPy is imported
    "NPY_DISABLE_CPU_FEATURES": "X86_V4,AVX512_ICL,AVX512_SPR,AVX512F,AVX512_SKX",
    "OPENBLAS_CORETYPE": "Haswell", "ATEN_CPU_CAPABILITY": "avx2", "NUMBA_CPU_NAME": "haswell",
}  # fmt: skip

from envs.evaluate import main
from m3depth.network import device, stereo_network
from m3depth.runtimes import openvino_network

for module in (device, stereo_network, openvino_network):
    module.fast_dtype = lambda chosen: None

if __name__ == "__main__":
    sys.exit(main())
