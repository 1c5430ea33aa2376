"""Feed a dataset to PyTorch: batches of image pairs with their true disparity.

python -m marssim.generate --out data/small --pairs 12 --views-per-scene 4 --seed 1 --renderer scan
python examples/read_dataset_pytorch.py
"""

from pathlib import Path

import torch
import tyro
from torch.utils.data import DataLoader, Dataset

from marssim import StereoDataset


class MarsPairs(Dataset):
    """A split of a dataset as tensors: images in [0, 1], disparity [px], and the pixels that count."""

    def __init__(self, folder: Path, split: str) -> None:
        self.samples = StereoDataset(folder, split=split)

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, index: int) -> dict[str, torch.Tensor]:
        sample = self.samples[index]
        return {
            "left": torch.from_numpy(sample.left).permute(2, 0, 1) / 255,  # (3, H, W)
            "right": torch.from_numpy(sample.right).permute(2, 0, 1) / 255,  # (3, H, W)
            "disparity": torch.from_numpy(sample.disparity),  # (H, W) [px]
            "scored": torch.from_numpy(sample.valid & ~sample.occluded),  # (H, W) bool
        }


def main(data: Path = Path("data/small"), split: str = "train", batch: int = 2) -> None:
    """Print the shapes and the mean disparity of each batch.

    Args:
        data: Dataset folder.
        split: Part of the dataset: train, val or test.
        batch: Pairs in a batch.
    """
    if not data.is_dir():
        settings = "--pairs 12 --views-per-scene 4 --seed 1 --renderer scan"
        raise SystemExit(f"{data}: no such folder; make it with: python -m marssim.generate --out {data} {settings}")
    pairs = MarsPairs(data, split)
    for number, item in enumerate(DataLoader(pairs, batch_size=batch)):
        mean = item["disparity"][item["scored"]].mean().item()
        print(f"batch {number}: left {tuple(item['left'].shape)}, mean disparity {mean:.1f} px")
    print(f"{len(pairs)} pairs of {split}")


if __name__ == "__main__":
    tyro.cli(main)
