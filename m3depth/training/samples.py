"""The samples of a training run: joined, cached, checked, shuffled, and prepared as batches in the background.

Every batch is a function of (seed, step, rank) alone, so that a resumed run continues with the same batches.
"""

from __future__ import annotations

import hashlib
import threading
from bisect import bisect_right
from collections import deque
from collections.abc import Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import accumulate, pairwise
from typing import Any

import numpy as np

from m3depth.datasets.depth_check import depth_misfit
from m3depth.datasets.labels import NO_NORMALS, advice
from m3depth.datasets.state import state_of_pairs
from m3depth.stereo.pairs import StereoPairs, pair_name
from m3depth.training.augmentation import AugmentConfig, augment, check_crop, random_crop
from m3depth.training.batch import Batch, finer_band, reduced, to_batch
from m3depth.training.packing import SKY, TRAINED, PackedSample, pack
from marssim.base.command.wording import counted

# Pixels of the rows that are trained at full resolution, over those of the reduced crop. The rows are as wide as the
# crop, since the right eye sees their matches up to hundreds of pixels away.
BAND = 1.5
LABELLED = 8  # first pairs of a dataset, one of which must have a pixel that is trained


class JoinedPairs:
    """Several sequences of samples as one, in their order. Indices below 0 count from the end.

    Attributes:
        parts: The sequences.
        ends: For each sequence, the number of samples up to its end.
        names: The name of each sample in its own sequence; with several sequences, after that of their folder.
    """

    def __init__(self, parts: Sequence[StereoPairs]) -> None:
        self.parts = parts
        self.ends = list(accumulate(map(len, parts)))
        prefixes = [f"{part.path.name}/" if len(parts) > 1 and hasattr(part, "path") else "" for part in parts]
        self.names = [
            prefix + pair_name(part, index) for prefix, part in zip(prefixes, parts) for index in range(len(part))
        ]

    @property
    def digest(self) -> str:
        """What identifies the content: state_of_pairs of a single sequence, and for several the SHA-256 of theirs."""
        states = [str(state_of_pairs(part)) for part in self.parts]
        return states[0] if len(states) == 1 else hashlib.sha256("\n".join(states).encode()).hexdigest()

    def __len__(self) -> int:
        return self.ends[-1] if self.ends else 0

    def __getitem__(self, index: int) -> Any:
        if not -len(self) <= index < len(self):
            raise IndexError(f"there are {len(self)} samples, none has the index {index}")
        position = index % len(self)
        part = bisect_right(self.ends, position)
        return self.parts[part][position - (self.ends[part - 1] if part else 0)]


class PackedCache:
    """Packed samples by index, kept in memory as long as they fit. Several threads may read it."""

    def __init__(self, samples: StereoPairs, limit_bytes: int) -> None:
        self.samples = samples
        self.limit = limit_bytes
        self.used = 0
        self._kept: dict[int, PackedSample] = {}
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, index: int) -> PackedSample:
        kept = self._kept.get(index)
        if kept is not None:
            return kept
        packed = pack(self.samples[index])
        with self._lock:
            if index not in self._kept and self.used + packed.nbytes <= self.limit:
                self._kept[index] = packed
                self.used += packed.nbytes
        return packed


def parts_of(samples: StereoPairs) -> list[range]:
    """Return the indices of each of the sequences that `samples` joins, or of all samples."""
    return [range(first, end) for first, end in pairwise([0, *getattr(samples, "ends", [len(samples)])])]


def check_crops(cache: PackedCache, samples: StereoPairs, size: tuple[int, int]) -> None:
    """Raise ValueError if the first pair of a dataset is smaller than the crops.

    Args:
        cache: The samples.
        samples: The same, which may be the JoinedPairs of several datasets.
        size: Height and width of the crops [px].
    """
    for part in parts_of(samples):
        if part:
            check_crop(cache[part.start], size, pair_name(samples, part.start))


def check_labels(cache: PackedCache, samples: StereoPairs) -> None:
    """Raise ValueError if the first pairs of a dataset, up to LABELLED, have no pixel whose depth is trained.

    Args:
        cache: The samples.
        samples: The same, which may be the JoinedPairs of several datasets.
    """
    for number, part in enumerate(parts_of(samples)):
        has_sky = False
        for index in part[:LABELLED]:
            flags = cache[index].flags
            if (flags & TRAINED).any():
                break
            has_sky |= bool((flags & SKY).any())
        else:
            if part:
                hint = advice(getattr(samples, "parts", [samples])[number], has_sky)
                raise ValueError(
                    f"{pair_name(samples, part.start)}: no pixel of {counted(len(part[:LABELLED]), 'pair')}, from this "
                    f"one on, has a depth that can be trained; {hint}"
                )


def warnings_of(cache: PackedCache, samples: StereoPairs, fitted_normals: bool) -> list[str]:
    """Return sentences on datasets whose labels are missing in part, or do not fit the images.

    Args:
        cache: The samples.
        samples: The same, which may be the JoinedPairs of several datasets.
        fitted_normals: Whether the normals are fitted to the depth.
    """
    normals = without_normals(cache, samples) if fitted_normals else []
    misfits = map(depth_misfit, getattr(samples, "parts", [samples]))
    return [
        *without_labels(cache, samples), *(f"{name} and the pairs after it: {NO_NORMALS}" for name in normals),
        *filter(None, misfits),
    ]  # fmt: skip


def without_labels(cache: PackedCache, samples: StereoPairs) -> list[str]:
    """Return a sentence for each dataset of whose first pairs, up to LABELLED, some have no pixel that is trained.

    Args:
        cache: The samples.
        samples: The same, which may be the JoinedPairs of several datasets.
    """
    sentences = []
    for number, part in enumerate(parts_of(samples)):
        first = part[:LABELLED]
        empty = [index for index in first if not (cache[index].flags & (TRAINED | SKY)).any()]
        if empty:
            hint = advice(getattr(samples, "parts", [samples])[number], has_sky=False)
            pairs = f"{len(empty)} of the first {counted(len(first), 'pair')} {'has' if len(empty) == 1 else 'have'}"
            sentences.append(f"{pair_name(samples, empty[0])}: {pairs} no pixel that can be trained; {hint}")
    return sentences


def without_normals(cache: PackedCache, samples: StereoPairs) -> list[str]:
    """Return the name of the first pair of each dataset whose first pairs, up to LABELLED, have no normals.

    Args:
        cache: The samples.
        samples: The same, which may be the JoinedPairs of several datasets.
    """
    return [
        pair_name(samples, part.start)
        for part in parts_of(samples)
        if part and not any(cache[index].normal.any() for index in part[:LABELLED])
    ]


def sample_index(count: int, position: int, seed: int) -> int:
    """Return the sample at a position of the endless, shuffled sequence of epochs.

    Args:
        count: Number of samples in an epoch.
        position: Position in the sequence, from 0.
        seed: Seed of the run.
    """
    epoch, place = divmod(position, count)
    return int(np.random.default_rng((seed, 1, epoch)).permutation(count)[place])


def make_batch(
    cache: PackedCache, step: int, size: int, crop_size: tuple[int, int], config: AugmentConfig, seed: int,
    rank: int = 0, world: int = 1,
) -> Batch:  # fmt: skip
    """Make the augmented training batch of one step and process.

    Args:
        cache: The samples.
        step: Step of the run, from 0.
        size: Crops in the batch.
        crop_size: Height and width of the crops [px].
        config: Augmentation.
        seed: Seed of the run.
        rank, world: Number of this process, and of all processes.

    Raises:
        ValueError: The images of a pair are smaller than the crops; the message names it.
    """
    items, finer = [], []
    for slot in range(size):
        position = (step * world + rank) * size + slot
        rng = np.random.default_rng((seed, 2, position))
        index = sample_index(len(cache), position, seed)
        sample = cache[index]
        check_crop(sample, crop_size, pair_name(cache.samples, index))
        part = random_crop(sample, crop_size, config, rng)
        images = augment(part.left, part.right, config, rng)
        if part.reduction == 1:
            items.append((*images, part))
            continue
        height = part.left.shape[0]
        rows = min(height, 32 * max(1, round(BAND * crop_size[0] / part.reduction / 32)))
        top = 8 * int(rng.integers((height - rows) // 8 + 1))
        finer.append(finer_band(slot, images, part, top, rows))
        items.append(reduced(images, part))
    return to_batch(items)._replace(finer=tuple(finer))


def batches(
    cache: PackedCache, start: int, size: int, crop_size: tuple[int, int], config: AugmentConfig, seed: int,
    rank: int = 0, world: int = 1, threads: int = 1,
) -> Generator[Batch, None, None]:  # fmt: skip
    """Yield the batches of steps start, start + 1, ..., prepared by background threads; arguments as of make_batch."""
    with ThreadPoolExecutor(threads, thread_name_prefix="loader") as pool:
        ahead: deque[Future[Batch]] = deque()
        step = start
        try:
            while True:
                while len(ahead) < threads + 2:
                    ahead.append(pool.submit(make_batch, cache, step, size, crop_size, config, seed, rank, world))
                    step += 1
                yield ahead.popleft().result()
        finally:
            for future in ahead:
                future.cancel()
