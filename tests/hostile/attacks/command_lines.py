"""Hostile command lines of every command, made from the fields of its config: a new flag is attacked as it comes."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import is_dataclass
from functools import partial
from importlib import import_module
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import tyro

from marssim.base.command.flags import parse

VALUES = (  # for flags of any kind
    "nan", "inf", "-inf", "0", "-0.0", "-1", "1", "1e300", "-1e300", "1e-300", "1e12", "99999999999", "9" * 40, "0x10",
    "1_000", "true", "none", "x", "", " ", "-", "--", "\u221e", "\u0661", "caf\udce9", "a" * 5000, "../..", "/",
    "/dev/null", "%s%n", "$(false)", "'", "[]", "{}", "os:abort", "builtins:exec", "a=b", "a,b", ":", "::",
)  # fmt: skip
CONFIGS = {  # the config of each command, and the least that it needs
    "marssim.generate": ("marssim.generation.config:GenerateOptions", ["--out", "out"]),
    "marssim.verify": ("marssim.verify:VerifyConfig", ["data"]),
    "marssim.export": ("marssim.export:ExportConfig", ["data", "--format", "kitti", "--out", "out"]),
    "marssim.mesh": ("marssim.mesh:MeshOptions", ["--out", "place.glb"]),
    "marssim.abundance": ("marssim.abundance:AbundanceConfig", []),
    "marssim.slopes": ("marssim.slopes:SlopesConfig", []),
    "m3depth.train": ("m3depth.training.config:TrainConfig", ["--data", "data", "--out", "out", "--max-steps", "1"]),
    "m3depth.evaluate": ("m3depth.evaluate:EvaluateOptions", ["--data", "data", "--out", "out"]),
    "m3depth.predict": ("m3depth.predict:PredictOptions", ["left.png", "right.png", "--out", "out"]),
    "m3depth.rectify": ("m3depth.rectification.options:RectifyOptions", ["left.png", "right.png", "--out", "out"]),
    "m3depth.export": ("m3depth.export:ExportOptions", ["--out", "model.onnx"]),
    "m3depth.ablate": ("m3depth.ablation.config:AblateOptions", ["--data", "data", "--out", "out", "--steps", "1"]),
    "m3depth.texture": ("m3depth.texture:TextureOptions", ["data", "--out", "out"]),
    "nav.replay": ("nav.replay:ReplayConfig", ["data"]),
    "nav.map": ("nav.map:MapOptions", ["data", "--out", "out"]),
    "envs.evaluate": ("envs.evaluation.config:EvaluateConfig", ["--out", "out"]),
    "envs.make_suite": ("envs.make_suite:MakeSuiteConfig", ["--out", "suite.json", "--name", "mine-v1"]),
    "envs.join": ("envs.join:JoinConfig", ["shard", "--out", "out"]),
    "envs.compare": ("envs.compare:CompareConfig", ["results.json"]),
    "envs.report": ("envs.report:ReportConfig", ["drive.zip"]),
    "envs.inspect": ("envs.inspect:InspectConfig", ["out"]),
    "envs.demo": ("envs.demo:DemoConfig", []),
    "envs.rocks": ("envs.rocks:RocksConfig", ["--data", "data", "--out", "out"]),
    "envs.train_ppo": ("envs.train_ppo:PPOConfig", ["--out", "out"]),
}


def config_of(command: str) -> Any:
    """Return the class of a command's config."""
    module, name = CONFIGS[command][0].split(":")
    return getattr(import_module(module), name)


def parser_of(command: str) -> Callable[[Sequence[str]], object]:
    """Return a function that parses a command line and checks it, as the command does before it opens any file."""
    if command == "marssim.generate":  # whose defaults depend on its scene
        return partial(import_module("marssim.generation.config").parse_generate, command, None)
    if command == "marssim.abundance":
        return import_module("marssim.abundance")._parse
    if command == "m3depth.train":
        return lambda args: import_module("m3depth.training.config").check_config(
            parse(config_of(command), command, None, args)
        )
    return lambda args: parse(config_of(command), command, None, args)


def flags_of(config: type, prefix: str = "--") -> Iterator[tuple[str, int]]:
    """Yield each flag of a config with the number of its values; -1 for any number, 0 for a switch.

    Values that stand without a flag, at the start of the line, have the flag "".
    """
    for name, hint in get_type_hints(config, include_extras=True).items():
        extras = getattr(hint, "__metadata__", ())
        if tyro.conf.Suppress in extras:
            continue
        if get_origin(hint) is Annotated:
            hint = get_args(hint)[0]
        flag = "" if tyro.conf.Positional in extras else prefix + name.replace("_", "-")
        if is_dataclass(hint):
            unnamed = any(getattr(extra, "name", None) == "" for extra in extras)
            yield from flags_of(hint, prefix if unnamed else f"{flag}.")
        else:
            yield flag, _width(hint)
            for alias in (alias for extra in extras for alias in getattr(extra, "aliases", None) or ()):
                yield alias, _width(hint)


def with_values(command: str, values: Sequence[tuple[str, Sequence[str]]]) -> list[str]:
    """Return the least command line of a command with flags and their values added, or put in place of its first words.

    Args:
        command: The command.
        values: Flags as flags_of yields them, each with its values.
    """
    least = CONFIGS[command][1]
    start = next((n for n, word in enumerate(least) if word.startswith("--")), len(least))
    first, rest = least[:start], least[start:]
    for flag, words in values:
        if flag:
            rest = [*rest, flag, *words]
        else:
            first = list(words)
    return [*first, *rest]


def _width(hint: Any) -> int:
    if hint is bool:
        return 0
    text = str(hint)
    if tuples := re.search(r"[Tt]uple\[([^\[\]]*)\]", text):
        return -1 if "..." in tuples[1] else tuples[1].count(",") + 1
    return 1
