"""Render a stereo pair with its ground truth from Python, without a dataset.

python examples/render_one_frame.py
python examples/render_one_frame.py --scene jezero --sun 12 --out out/low_sun
"""

from pathlib import Path

import cv2
import numpy as np
import tyro

from marssim import build_scene, load_place, render_view


def main(
    out: Path = Path("out/frame"), scene: str = "gale", sun: float = 35.0, yaw: float = 90.0, seed: int = 1
) -> None:
    """Render one view and write both images, and the depth of the left one.

    Args:
        out: Folder for left.png, right.png and depth.npy.
        scene: A preset, or a place file.
        sun: Height of the sun [deg].
        yaw: Viewing direction [deg], counter-clockwise from east.
        seed: Seed of the scene.
    """
    world = build_scene(load_place(scene), rng=seed)
    frame = render_view(world, x=0.0, y=0.0, yaw_deg=yaw, sun_elevation_deg=sun)
    out.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(out / "left.png"), frame.left[..., ::-1])
    cv2.imwrite(str(out / "right.png"), frame.right[..., ::-1])
    np.save(out / "depth.npy", frame.depth)
    ground = frame.depth[np.isfinite(frame.depth)]
    print(f"depth from {ground.min():.1f} m to {ground.max():.0f} m, see {out}")


if __name__ == "__main__":
    tyro.cli(main)
