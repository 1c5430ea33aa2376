from .checked_inference import EstimatorError
from .datasets.config import DataConfig
from .datasets.open import open_pairs
from .estimator import Estimator, EstimatorName, load_estimator
from .network.config import M3DepthConfig
from .network.model import M3Depth
from .stereo.classical import SGBM, BlockMatching
from .stereo.pairs import StereoPairs
from .stereo.prediction import Prediction
from .weights import SHIPPED_WEIGHTS

__version__: str

__all__ = [
    "SGBM",
    "SHIPPED_WEIGHTS",
    "BlockMatching",
    "DataConfig",
    "Estimator",
    "EstimatorError",
    "EstimatorName",
    "M3Depth",
    "M3DepthConfig",
    "Prediction",
    "StereoPairs",
    "load_estimator",
    "open_pairs",
]
