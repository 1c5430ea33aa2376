"""The pairs of the committed manifest, and a small manifest from its pairs to its table."""

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from small_network import SMALL
from small_rivals import TINY as TINY_RIVALS

from m3depth.kinds.networks import new_network
from m3depth.network.model import M3Depth
from m3depth.rivals.config import SOURCES
from m3depth.runtimes.choice import recorded_runtime
from marssim.base.camera import NATECAM
from marssim.base.files.json_file import read_json
from marssim.generation.config import parse_generate
from marssim.scene.presets import PRESETS

pytestmark = pytest.mark.usefixtures("undrawn_figures")

RIG = ["--rig.width", "64", "--rig.height", "64", "--rig.focal", "74.5", "--views-per-scene", "1"]
TINY = {
    "generate": ["--renderer", "scan"],
    "seeds": {"utopia": 5},
    "sizes": {"64": {"generate": RIG, "evaluate": ["--max-disparity", "24"], "pairs": {"utopia": 2}}},
    "sets": {"clean": {"generate": []}, "degraded": {"of": "clean", "degrade": "contrast=.33"}},
}


@pytest.fixture
def tiny(tmp_path) -> Path:
    file = tmp_path / "manifest.json"
    file.write_text(json.dumps(TINY))
    return file


def test_the_manifest_has_200_60_and_20_pairs_of_all_places_at_its_sizes(score_manifest):
    parts = score_manifest.parts_of(read_json(score_manifest.MANIFEST))
    pairs = Counter()
    for part in parts:
        pairs[part.size, part.name] += part.pairs
    expected = {"512": 200, "1024": 60, "2048": 20}
    assert pairs == {
        **{(size, name): n for size, n in expected.items() for name in ("clean", "degraded", "sun10")},
        ("512", "dust"): 40,
    }
    assert {part.place for part in parts if part.name == "clean"} == set(PRESETS)


def test_every_part_of_the_manifest_is_a_dataset_of_natecams_view_with_a_seed_of_its_own(score_manifest):
    seeds, parsed = {}, set()
    for part in score_manifest.parts_of(read_json(score_manifest.MANIFEST)):
        seed = int(part.generate[part.generate.index("--seed") + 1])
        seeds.setdefault(seed, set()).add((part.place, part.name == "dust"))
        if (part.size, part.name) in parsed or part.degrade is not None:
            continue
        parsed.add((part.size, part.name))
        config = parse_generate("generate", None, ["--out", "out", *part.generate])
        camera, scale = config.rig.camera, int(part.size) / 512
        assert (camera.width, camera.height) == (int(part.size),) * 2 and config.rig.baseline == NATECAM.baseline
        assert camera.fx == pytest.approx(scale * NATECAM.camera.fx, rel=1e-4)
        assert [scene.preset for scene in config.scenes] == [part.place]
        assert config.seed == seed
        if part.name == "sun10":
            assert config.scenes[0].look.sun_elevation_deg == (10, 10)
        limit = ("--max-disparity", f"{192 * scale:g}")
        assert part.evaluate == (() if scale == 1 else limit)
    assert all(910101 <= seed <= 910999 and len(places) == 1 for seed, places in seeds.items())


def test_pairs_are_made_scored_and_put_into_one_table(score_manifest, tiny, tmp_path, monkeypatch, capsys):
    torch.manual_seed(0)
    weights = tmp_path / "mine.safetensors"
    M3Depth(SMALL).save_pretrained(weights)
    out = tmp_path / "out"
    arguments = ["--data", str(tmp_path / "data"), "--out", str(out), "--manifest", str(tiny), "--workers", "1"]
    arguments += ["--weights", str(weights), "--sets", "degraded"]
    assert score_manifest.main(arguments) == 0
    summary = read_json(out / "summary.json")
    part = summary["parts"]["64"]["degraded"]
    assert part["pairs"] == part["scenes"] == 2
    runtime = recorded_runtime(["m3depth"])
    assert summary["runtime"] == runtime and f"\nNetworks ran in {runtime}. python " in (out / "summary.md").read_text()
    assert (
        f" one machine. Networks ran in {runtime}. python " in (out / "depth/64/degraded/utopia/results.md").read_text()
    )
    assert [folder.name for folder in (tmp_path / "data" / "64").iterdir()] == ["clean"]  # whose images are degraded
    depth = read_json(out / "depth" / "64" / "degraded" / "utopia" / "results.json")
    assert depth["degrade"] == "contrast=.33" and depth["max_disparity_px"] == 24
    mean = depth["methods"]["mine"]["depth"]["all"]["per_image"]["abs_rel"]
    own, sgbm = (part["depth"][method] for method in ("mine", "SGBM"))
    assert own["abs_rel"]["value"] == pytest.approx(mean) and sgbm["abs_rel"]["ratio"] == 1
    assert own["places"]["utopia"]["abs_rel"] == pytest.approx(mean)
    assert list(part["map"]) == ["mine", "SGBM", "ground_truth"]
    text = (out / "summary.md").read_text()
    assert "## 64 px, degraded" in text and "\nThose in the navigator's map, by envs/rock_map.py:\n" in text

    def again(flags):
        raise AssertionError("scored twice")

    with monkeypatch.context() as patch:
        patch.setattr(score_manifest, "evaluate", again)
        patch.setattr(score_manifest, "count_rocks", again)
        assert score_manifest.main(arguments) == 0

    done = []
    monkeypatch.setattr(score_manifest, "evaluate", lambda flags: done.append(flags) or 130)
    with monkeypatch.context() as patch:
        patch.setattr(score_manifest, "recorded_runtime", lambda names, wanted: "openvino of another version")
        assert score_manifest.main(arguments) == 130 and done.pop().count("--runtime") == 1 and not done
    capsys.readouterr()
    assert score_manifest.main([*arguments, "--limit", "1"]) == 2 and not done
    assert "utopia holds 2 pairs; give another --data" in capsys.readouterr().err


def test_the_map_is_left_out_and_the_baselines_are_those_that_the_flags_name(score_manifest, tiny, tmp_path):
    """Another state of the code has begun to score the part before, and was stopped."""
    weights = tmp_path / "mine.safetensors"
    M3Depth(SMALL).save_pretrained(weights)
    out = tmp_path / "out"
    begun = out / "depth/64/clean/utopia"
    begun.mkdir(parents=True)
    (begun / "unfinished.npz").write_bytes(b"scores of another state of the code")
    (begun / "state.json").write_text('{"code": "another"}')
    arguments = ["--data", str(tmp_path / "data"), "--out", str(out), "--manifest", str(tiny), "--workers", "1"]
    arguments += ["--weights", str(weights), "--sets", "clean", "--limit", "1", "--no-map", "--baselines", "sad"]
    arguments += ["--estimator", "sad,unfilled"]
    assert score_manifest.main(arguments) == 0
    part = read_json(out / "summary.json")["parts"]["64"]["clean"]
    filled, unfilled = (part["depth"][name]["abs_rel"]["value"] for name in ("SAD", "SAD, unfilled"))
    assert filled < unfilled  # since unknown depth counts as 80 m
    assert list(part["depth"]) == ["mine", "SAD", "SAD, unfilled"] and part["map"] == {} and not (out / "map").exists()
    assert "the navigator's map" not in (out / "summary.md").read_text()


def test_weights_that_need_the_true_depth_are_not_scored_in_the_map(score_manifest, tmp_path, monkeypatch):
    paths = {name: tmp_path / f"{name}.safetensors" for name in ("mine", "given")}
    M3Depth(SMALL).save_pretrained(paths["mine"])
    new_network(replace(TINY_RIVALS["fusion"], true_depth=True)).save_pretrained(paths["given"])
    calls = {}
    monkeypatch.setattr(score_manifest, "evaluate", lambda flags: calls.update(depth=flags) or 0)
    monkeypatch.setattr(score_manifest, "count_rocks", lambda flags: calls.update(map=flags) or 0)
    options = score_manifest.Options(tmp_path, tmp_path / "out", tuple(paths.values()), max_pixels=4096)
    part = score_manifest.Part("64", "clean", "utopia", "clean", 2, (), (), None)
    for kind in ("depth", "map"):
        part.scores(options.out, kind).mkdir(parents=True)
    score_manifest.score(
        part, SimpleNamespace(path=tmp_path, digest="0"), options, score_manifest.weights_by_kind(options)
    )
    assert [str(path) in calls["depth"] for path in paths.values()] == [True, True]
    assert [f"m3depth:{path}" in calls["map"] for path in paths.values()] == [True, False]
    assert ["--max-pixels" in flags for flags in (calls["depth"], calls["map"])] == [True, False]


def test_a_method_whose_file_has_changed_is_scored_again(score_manifest, tmp_path, monkeypatch):
    weights, other = tmp_path / "mine.safetensors", tmp_path / "other.safetensors"
    calls = []
    monkeypatch.setattr(score_manifest, "evaluate", lambda flags: calls.append(flags) or 0)
    M3Depth(SMALL).save_pretrained(weights)
    options = score_manifest.Options(
        tmp_path, tmp_path / "out", (weights,), map=False, estimator=(f"Other=m3depth:{other}", "sgbm,unfilled")
    )
    part = score_manifest.Part("64", "clean", "utopia", "clean", 2, (), (), None)
    part.scores(options.out, "depth").mkdir(parents=True)
    for expected in (1, 2):
        M3Depth(SMALL).save_pretrained(other)  # new random weights
        for _ in range(2):
            score_manifest.score(
                part, SimpleNamespace(path=tmp_path, digest="0"), options, score_manifest.weights_by_kind(options)
            )
            assert len(calls) == expected
    source = tmp_path / "own.py"
    source.write_text("width = 1\n")
    monkeypatch.setitem(SOURCES, SMALL.KIND, source)  # of a network of one's own
    score_manifest.score(
        part, SimpleNamespace(path=tmp_path, digest="0"), options, score_manifest.weights_by_kind(options)
    )
    assert len(calls) == 3


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--sizes", "512"], "--sizes 512: unknown; the manifest has 64"),
        (["--sets", "clear"], "--sets clear: unknown; the manifest has clean, degraded"),
        (["--weights", "missing.safetensors"], "missing.safetensors"),
        (["--weights", "shipped", "shipped"], "--weights must name one file or more, each once"),
        (["--limit", "0"], "--limit must be at least 1"),
        (["--manifest", "missing.json"], "missing.json: no such file"),
    ],
)
def test_mistakes_are_one_line_and_nothing_is_made(score_manifest, tiny, tmp_path, capsys, more, message):
    data = tmp_path / "data"
    arguments = ["--data", str(data), "--out", str(tmp_path / "out"), "--manifest", str(tiny), *more]
    assert score_manifest.main(arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ") and error.count("\n") == 1 and message in error
    assert not data.exists()


@pytest.mark.parametrize("lost", ["seeds", "sizes", "sets", "generate"])
def test_a_manifest_without_an_entry_is_named(score_manifest, tiny, tmp_path, capsys, lost):
    tiny.write_text(json.dumps({name: entry for name, entry in TINY.items() if name != lost}))
    arguments = ["--data", str(tmp_path / "data"), "--out", str(tmp_path / "out"), "--manifest", str(tiny)]
    assert score_manifest.main(arguments) == 2
    assert f"{tiny}: an entry is missing or malformed: '{lost}'" in capsys.readouterr().err
