"""Images made worse on purpose: what dust, bad focus, low light and a rig out of adjustment do to a pair."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields

import cv2
import numpy as np

MAX_VERTICAL = 16.0  # [px]


@dataclass(frozen=True)
class Degradation:
    """Applied in this order, the first two to the right eye alone, the others to both alike, noise drawn for each.

    vertical: rows that the right image lies too low [px], interpolated by Lanczos; gain: its brightness by that of the
    left one; contrast: factor about the image's mean; blur: standard deviation [px]; noise: standard deviation [grey
    levels].
    """

    vertical: float = 0.0
    gain: float = 1.0
    contrast: float = 1.0
    blur: float = 0.0
    noise: float = 0.0

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if name == "vertical" and not abs(value) <= MAX_VERTICAL:
                raise ValueError(f"degradation vertical must lie in [{-MAX_VERTICAL}, {MAX_VERTICAL}] px, got {value}")
            if name != "vertical" and not (np.isfinite(value) and value >= 0):
                raise ValueError(f"degradation {name} must be a number >= 0, got {value}")

    @classmethod
    def parse(cls, text: str) -> Degradation:
        """Read "contrast=.33,blur=1,noise=2.5"; what is left out stays. Raises ValueError that names a field."""
        known = {field.name for field in fields(cls)}
        values: dict[str, float] = {}
        for part in filter(None, (p.strip() for p in text.split(","))):
            name, _, value = part.partition("=")
            if name not in known:
                raise ValueError(f"`degrade`: unknown field {name!r}; known are {', '.join(sorted(known))}")
            try:
                values[name] = float(value)
            except ValueError:
                raise ValueError(f"`degrade`: {name} must be a number, got {value!r}") from None
        return cls(**values)

    def apply(self, left: np.ndarray, right: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """The eyes, (H, W) or (H, W, 3) uint8, in, the same out."""
        askew: np.ndarray = right.astype(np.float32)
        if self.vertical:
            move = np.array([[1, 0, 0], [0, 1, self.vertical]])
            size = (right.shape[1], right.shape[0])
            askew = cv2.warpAffine(askew, move, size, flags=cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REFLECT_101)
        return self._blurred(left.astype(np.float32), rng), self._blurred(np.float32(self.gain) * askew, rng)

    def _blurred(self, out: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        if self.contrast != 1:
            mean = out.mean()
            out = mean + np.float32(self.contrast) * (out - mean)
        if self.blur > 0:
            out = cv2.GaussianBlur(out, (0, 0), self.blur, borderType=cv2.BORDER_REFLECT_101)
        if self.noise > 0:
            out = out + self.noise * rng.standard_normal(out.shape, dtype=np.float32)
        return np.clip(np.round(out), 0, 255).astype(np.uint8)
