"""The named places on Mars: the rocks, the relief and the look of each."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, get_args

from marssim.scene.look import LookConfig
from marssim.scene.outcrop.config import OutcropConfig
from marssim.scene.relief import ReliefConfig
from marssim.scene.rocks.mesh import RockConfig
from marssim.scene.scene import SceneConfig

Place = Literal["utopia", "gusev", "gale", "jezero", "gravel", "hard"]
PRESETS: tuple[Place, ...] = get_args(Place)

# The relief of gusev, gale and jezero has the RMS slope over 1 m and the Hurst exponent of Pathfinder and Viking 1,
# which have slopes of 4.8 to 5.4 deg over 1 m, 2.5 to 3.0 over 10 m and 1.2 to 1.7 over 100 m. Utopia is smoother: 98 %
# of its slopes are under 8 deg. Hard is rougher than any of them,
# and has ditches.
_PRESETS: dict[Place, tuple[RockConfig, ReliefConfig, LookConfig, OutcropConfig]] = {
    # a dusty plain: few rocks, worn and half buried, broad ripples, old craters
    "utopia": (
        RockConfig(k=0.033, families=(0.3, 0.2, 0.5), albedo=1.05, buried=(0.2, 0.75)),
        ReliefConfig(
            hurst=0.72, rms_slope_deg=2.8, crater_density=0.005, crater_depth=(0.03, 0.12), ripple_amplitude=0.02,
            ripple_wavelength=1.1, ripple_cover=0.45,
        ),
        LookConfig(
            pebbles=(0.1, 0.5), wind_ripples=(0.2, 0.7), bedding=(0.0, 0.2), bedrock=(0.0, 0.0), rock_dust=(0.2, 0.8),
            gravel=(0.0, 0.05), drifts=(0.3, 1.0), soil_albedo=(0.6, 1.0),
        ),
        OutcropConfig(slabs=(0.0, 0.03), slab_size=(0.25, 0.5), fragments=(0.0, 0.3)),
    ),
    # a lava plain: dark angular blocks around small craters
    "gusev": (
        RockConfig(k=0.05, families=(0.75, 0.1, 0.15), albedo=0.95, cluster=0.4),
        ReliefConfig(
            hurst=0.74, rms_slope_deg=4.8, crater_density=0.01, ripple_amplitude=0.006, ripple_wavelength=0.5,
            ripple_cover=0.3,
        ),
        LookConfig(
            pebbles=(0.25, 0.6), wind_ripples=(0.1, 0.5), bedding=(0.0, 0.2), bedrock=(0.0, 0.15), rock_dust=(0.1, 0.6),
            gravel=(0.0, 0.3), drifts=(0.2, 0.7), soil_albedo=(0.55, 1.05),
        ),
        OutcropConfig(slabs=(0.0, 0.1), fragments=(0.2, 0.8)),
    ),
    # a lake bed: layered slabs and ledges, thin chips, rippled sand
    "gale": (
        RockConfig(
            k=0.07, families=(0.35, 0.6, 0.05), height_ratio=0.4, albedo=1.15, albedo_spread=0.15, buried=(0.3, 0.75),
        ),
        ReliefConfig(
            hurst=0.73, rms_slope_deg=5.1, crater_density=0.002, ripple_amplitude=0.01, ripple_wavelength=0.8,
            ripple_cover=0.55,
        ),
        LookConfig(
            albedo_contrast=(0.5, 1.2), texture_strength=(0.6, 1.2),
            pebbles=(0.05, 0.35), wind_ripples=(0.2, 0.65), bedding=(0.6, 1.0), bedrock=(0.1, 0.45),
            rock_dust=(0.1, 0.5), gravel=(0.0, 0.05), drifts=(0.4, 1.0), soil_albedo=(0.55, 0.85),
        ),
        OutcropConfig(
            slabs=(0.25, 0.65), slab_size=(0.3, 0.9), slab_height=(0.02, 0.05), ledges=(1.0, 8.0), fragments=(0.5, 1.0),
            brightness=(0.95, 1.3),
        ),
    ),
    # a delta's foot: pavement of broken bedrock, low rocks of every kind, pebbles and sand in between
    "jezero": (
        RockConfig(
            k=0.15, families=(0.45, 0.25, 0.3), height_ratio=0.42, albedo=1.15, albedo_spread=0.2, buried=(0.25, 0.75),
        ),
        ReliefConfig(hurst=0.73, rms_slope_deg=5.2, ripple_amplitude=0.02, ripple_wavelength=1.4, ripple_cover=0.2),
        LookConfig(
            albedo_contrast=(0.6, 1.2), texture_strength=(0.8, 1.5),
            pebbles=(0.8, 1.0), wind_ripples=(0.0, 0.25), bedding=(0.1, 0.8), bedrock=(0.1, 0.5),
            rock_dust=(0.1, 0.6), gravel=(0.1, 0.4), gravel_size=(0.01, 0.025), drifts=(0.2, 0.6),
            soil_albedo=(0.65, 0.9),
        ),
        OutcropConfig(
            slabs=(0.45, 0.7), slab_size=(0.35, 1.0), slab_tilt_deg=(0.5, 3.0), slab_height=(0.02, 0.045),
            ledges=(0.0, 2.0), fragments=(0.3, 0.9), brightness=(1.0, 1.3),
        ),
    ),
    # the floor of a crater: stones of a few centimetres, close together, between sand and rocks
    "gravel": (
        RockConfig(k=0.05, families=(0.5, 0.2, 0.3), albedo=1.1),
        ReliefConfig(hurst=0.73, rms_slope_deg=4.0, ripple_amplitude=0.015, ripple_wavelength=1.0, ripple_cover=0.2),
        LookConfig(
            pebbles=(0.3, 0.6), wind_ripples=(0.0, 0.4), bedding=(0.0, 0.4), bedrock=(0.0, 0.1), rock_dust=(0.1, 0.6),
            gravel=(0.5, 1.0), gravel_size=(0.01, 0.05), gravel_sorting=(0.0, 1.0), drifts=(0.1, 0.6),
            soil_albedo=(0.6, 1.0),
        ),
        OutcropConfig(slabs=(0.0, 0.05), slab_size=(0.25, 0.5), fragments=(0.1, 0.5)),
    ),
    "hard": (
        RockConfig(k=0.20, cluster=0.5, families=(0.6, 0.2, 0.2), albedo=1.05),
        ReliefConfig(
            hurst=0.6, rms_slope_deg=7.0, crater_density=0.008, ripple_amplitude=0.02, ripple_wavelength=0.7,
            ripple_cover=0.15, fresh_crater_density=0.0005, ditch_density=0.0005,
        ),
        LookConfig(
            pebbles=(0.2, 0.6), wind_ripples=(0.0, 0.6), bedding=(0.0, 0.6), bedrock=(0.0, 0.3), rock_dust=(0.0, 0.6),
            gravel=(0.0, 0.4), drifts=(0.1, 0.8), soil_albedo=(0.5, 1.1),
        ),
        OutcropConfig(slabs=(0.0, 0.3), slab_tilt_deg=(2.0, 7.0), ledges=(0.0, 6.0), fragments=(0.3, 1.0)),
    ),
}  # fmt: skip


def preset(name: str, **changes: object) -> SceneConfig:
    """Return the SceneConfig of a named place.

    Args:
        name: One of PRESETS.
        **changes: Fields of SceneConfig to replace.

    Raises:
        ValueError: There is no place of that name, or a changed field is out of range.
    """
    if name not in _PRESETS:
        raise ValueError(f"scene preset {name!r} is unknown; choose from {', '.join(PRESETS)}")
    rocks, relief, look, outcrop = _PRESETS[name]
    place = SceneConfig(preset=name, rocks=rocks, relief=relief, look=look, outcrop=outcrop)
    return replace(place, **changes)  # type: ignore[arg-type]
