from .base.camera import MAX_DEPTH, MIN_DEPTH, NATECAM, PinholeCamera, StereoRig
from .base.dataset.dataset import StereoDataset
from .base.dataset.frame import StereoFrame
from .base.dataset.sample import StereoSample, read_sample, write_sample
from .base.files.json_file import DatasetError
from .base.pose import look_pose
from .generate import generate_dataset
from .generation.config import GenerateConfig
from .render.renderers.by_name import RENDERERS, default_renderer, make_renderer
from .render.renderers.renderer import Renderer
from .render.sensor import Sensor, SensorConfig
from .render.stereo import render_stereo
from .render.surfaces.shading import Shader
from .render.view import SceneRenderer, render_view
from .scene.look import LookConfig
from .scene.place_file import load_place, save_place
from .scene.presets import PRESETS, preset
from .scene.relief import ReliefConfig
from .scene.rocks.population import RockConfig
from .scene.scene import Scene, SceneConfig, build_scene
from .scene.viewpoint import ViewConfig, draw_pose, pose_on_ground

__version__: str

__all__ = [
    "MAX_DEPTH",
    "MIN_DEPTH",
    "NATECAM",
    "PRESETS",
    "RENDERERS",
    "DatasetError",
    "GenerateConfig",
    "LookConfig",
    "PinholeCamera",
    "ReliefConfig",
    "Renderer",
    "RockConfig",
    "Scene",
    "SceneConfig",
    "SceneRenderer",
    "Sensor",
    "SensorConfig",
    "Shader",
    "StereoDataset",
    "StereoFrame",
    "StereoRig",
    "StereoSample",
    "ViewConfig",
    "build_scene",
    "default_renderer",
    "draw_pose",
    "generate_dataset",
    "load_place",
    "look_pose",
    "make_renderer",
    "pose_on_ground",
    "preset",
    "read_sample",
    "render_stereo",
    "render_view",
    "save_place",
    "write_sample",
]
