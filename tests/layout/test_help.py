"""The help of every command's flags, compared with the values that their configs refuse."""

import re
from collections.abc import Iterator
from dataclasses import is_dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any, get_type_hints

import docstring_parser
import pytest
from command_lines import CONFIGS, config_of

from marssim.scene.rocks.population import RockConfig

COMMANDS = {  # configs of the commands' flags, with values for those that have no default
    "marssim.generation.config:GenerateOptions": {"out": Path("out")},
    "marssim.verify:VerifyConfig": {"data": Path("data")},
    "marssim.export:ExportConfig": {"data": Path("data"), "format": "kitti", "out": Path("out")},
    "marssim.slopes:SlopesConfig": {},
    "marssim.mesh:MeshOptions": {"out": Path("place.glb")},
    "marssim.abundance:AbundanceConfig": {"rocks": RockConfig()},
    "m3depth.ablation.config:AblateOptions": {"data": (Path("data"),), "out": Path("out"), "steps": 1},
    "m3depth.prediction.options:PredictOptions": {"images": (Path("a"), Path("b")), "out": Path("out")},
    "nav.map:MapOptions": {"data": Path("data"), "out": Path("out")},
    "nav.replay:ReplayConfig": {"data": Path("data")},
    "m3depth.rectification.options:RectifyOptions": {"images": (Path("a"), Path("b")), "out": Path("out")},
    "m3depth.export:ExportOptions": {"out": Path("model.onnx")},
    "m3depth.texture:TextureOptions": {"images": (Path("data"),), "out": Path("out")},
    "m3depth.evaluation.command.options:EvaluateOptions": {"data": Path("data"), "out": Path("out")},
    "m3depth.training.config:TrainConfig": {"data": (Path("data"),), "out": Path("out")},
    "envs.train_ppo:PPOConfig": {"out": Path("out")},
    "envs.demo:DemoConfig": {},
    "envs.evaluation.config:EvaluateConfig": {"out": Path("out")},
    "envs.make_suite:MakeSuiteConfig": {"out": Path("out.json"), "name": "mine-v1"},
    "envs.rocks:RocksConfig": {"data": Path("data"), "out": Path("out")},
}
ELSEWHERE = {"film_courses", "bag_courses"}  # whose limit is another flag's value
FAR = 10**8  # beyond all limits
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")


def numeric_flags(config: Any) -> Iterator[tuple[Any, str, str, Any]]:
    """Yield config, name, type and value of each flag that takes numbers."""
    for name, hint in get_type_hints(type(config)).items():
        value = getattr(config, name)
        if is_dataclass(value):
            yield from numeric_flags(value)
        elif re.search(r"\b(int|float)\b", str(hint)) and name not in ELSEWHERE:
            yield config, name, str(hint), value


def refusals(config: Any, name: str, hint: str, value: Any) -> Iterator[str]:
    """Yield what a config says about values that are too small and too large, without the value."""
    for number in (-FAR, 0, FAR):
        number = number if re.search(r"\bint\b", hint) else float(number)
        count = len(value) if isinstance(value, tuple) and value else 2 if "Range" in hint else 1
        try:
            replace(config, **{name: (number,) * count if "tuple" in hint else number})
        except ValueError as error:
            yield str(error).partition(", got")[0]


def help_of(config: type, name: str) -> str:
    for owner in config.__mro__:
        for entry in docstring_parser.parse_from_object(owner).params if is_dataclass(owner) else ():
            if entry.arg_name == name:
                return " ".join((entry.description or "").split())
    return ""


def test_the_help_of_every_command_with_numbers_is_checked():
    numbers = set()
    for command in CONFIGS:
        hints = get_type_hints(config_of(command)).values()
        if any(re.search(r"\b(int|float)\b", str(hint)) or is_dataclass(hint) for hint in hints):
            numbers.add(command)
    listed = {getattr(import_module(module), name) for module, name in (each.split(":") for each in COMMANDS)}
    assert {config_of(command) for command in numbers} <= listed


@pytest.mark.parametrize("command", COMMANDS)
def test_the_help_of_a_flag_states_the_limits_of_its_value(command):
    module, config = command.split(":")
    for part, name, hint, value in numeric_flags(getattr(import_module(module), config)(**COMMANDS[command])):
        text = help_of(type(part), name)
        stated = {float(number) for number in NUMBER.findall(text.replace(",000", "000"))}
        for message in refusals(part, name, hint, value):
            if "must" not in message:
                continue
            assert {float(number) for number in NUMBER.findall(message)} <= stated, f"{name}: {text}: {message}"
            assert "positive" not in message or re.search("above 0|at least 1|1 or more", text), f"{name}: {text}"
