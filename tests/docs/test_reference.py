"""The reference holds every command, every flag and every public name, and the pages' command lines parse."""

import re
import shlex
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from marssim.base.command.flags import parse
from marssim.base.command.listing import COMMANDS

ROOT = Path(__file__).parents[2]
MODULES = [f"{package}.{command}" for package, commands in COMMANDS.items() for command in commands]
PAGES = [ROOT / "README.md", ROOT / "examples" / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
# What a command line of the pages stands for, where it must be more than a name.
OWN = {"PLACE": "gale", "SEED": "7"}


@pytest.fixture(scope="module")
def pages(reference_pages):
    return reference_pages.pages()


@pytest.mark.parametrize("module", MODULES)
def test_every_command_and_each_of_its_flags_is_in_the_reference(module, pages, reference_pages):
    package = module.partition(".")[0]
    page = pages[f"reference/commands-{package}.md"]
    assert f"## python -m {module}\n" in page
    section = page.partition(f"## python -m {module}\n")[2].partition("\n## ")[0]
    actions = reference_pages.flags(import_module(module))._actions
    flags = [option for action in actions for option in action.option_strings if option not in ("-h", "--help")]
    assert flags and [flag for flag in flags if f"`{flag}`" not in section] == []


@pytest.mark.parametrize("module", MODULES)
def test_every_flag_has_a_meaning_in_the_reference(module, pages):
    section = pages[f"reference/commands-{module.partition('.')[0]}.md"].partition(f"## python -m {module}\n")[2]
    rows = [line for line in section.partition("\n## ")[0].splitlines() if line.startswith("| `--")]
    assert rows and all(re.search(r"\| \S.*\|$", row) for row in rows)


def test_a_cell_of_the_reference_shows_bars_without_a_backslash(pages, reference_pages):
    for page in pages.values():
        rows = [line for line in page.splitlines() if line.startswith("|")]
        assert not any("\\|" in code for row in rows for code in re.findall(r"`[^`]*`|<code>.*?</code>", row))
        assert all(len(re.findall(r"(?<!\\)\|", row)) == 3 for row in rows if row.startswith("| `--"))
    assert "<code>{utopia,<wbr>" in pages["reference/commands-marssim.md"]
    assert reference_pages._cell("`a|<b>` or c|<d>, `e`") == "<code>a&#124;<wbr>&#60;b&#62;</code> or c\\|&lt;d>, `e`"


@pytest.mark.parametrize("package", list(COMMANDS))
def test_every_public_name_is_in_the_reference_and_can_be_imported(package, pages):
    module = import_module(package)
    assert module.__all__
    for name in module.__all__:
        assert f"::: {package}.{name}\n" in pages[f"reference/api-{package}.md"]
        assert hasattr(module, name)


def test_the_environment_is_in_the_reference_with_every_argument(pages):
    import inspect

    from envs.mars_nav import MarsNavEnv

    for name in list(inspect.signature(MarsNavEnv.__init__).parameters)[1:]:
        assert f"| `{name}` |" in pages["reference/marsnav-v0.md"]
    assert "Observation space" in pages["reference/marsnav-v0.md"]


def commands(page: Path) -> list[str]:
    """The command lines of a page that call one of our modules, each as one line."""
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    for variable, flags in arrays(text).items():
        text = text.replace(f'"${{{variable}[@]}}"', flags)
    lines = [line.strip() for line in text.splitlines() if re.match(r" {4,}\S", line)]
    return [
        line
        for line in lines
        if re.match(r"([A-Z_]+=\S* )*(python|torchrun\b.*) -m (marssim|m3depth|nav|envs)\.", line)
    ]


def arrays(text: str) -> dict[str, str]:
    """The flags that a page puts into variables of the shell."""
    matches = re.findall(r"^ {4}([A-Z]+)=\(([^)]*)\)$", text, re.MULTILINE)
    return {variable: " ".join(flags.split()) for variable, flags in matches}


LINES = [(page.relative_to(ROOT).as_posix(), line) for page in PAGES for line in commands(page)]


def test_the_guides_hold_command_lines():
    assert len(LINES) > 200


def test_the_methods_are_trained_on_the_ranges_of_the_guide():
    guide = " ".join((ROOT / "docs/guides/train.md").read_text(encoding="utf-8").replace("\\\n", " ").split())
    ranges = arrays((ROOT / "docs/results/methods.md").read_text(encoding="utf-8"))
    assert set(ranges) == {"WIDE", "BLANK"} and all(flags in guide for flags in ranges.values())


@pytest.mark.parametrize(("page", "line"), LINES, ids=lambda value: value[:60])
def test_every_command_line_of_the_pages_parses(page, line, reference_pages, capsys, tmp_path, monkeypatch):
    (tmp_path / "my_place.json").write_text('{"preset": "gale"}')
    np.save(tmp_path / "dem.npy", np.zeros((400, 400)))
    monkeypatch.chdir(tmp_path)
    module, args = reference_pages.command_line(re.sub("|".join(OWN), lambda word: OWN[word[0]], line))
    try:
        reference_pages.parse(module, args)
    except SystemExit as end:
        assert not end.code, f"{page}: {line}\n{capsys.readouterr().err}"


def script_lines(page: Path) -> list[str]:
    """The command lines of a page that call a script of docs/ with flags, each as one line."""
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    lines = [line.strip() for line in text.splitlines() if re.match(r" {4,}\S", line)]
    return [line for line in lines if re.match(r"([A-Z_]+=\S* )*python docs/\S+\.py( |$)", line)]


SCRIPT_LINES = [(page.relative_to(ROOT).as_posix(), line) for page in PAGES for line in script_lines(page)]


@pytest.mark.parametrize(("page", "line"), SCRIPT_LINES, ids=lambda value: value[:60])
def test_every_command_line_of_a_script_parses(page, line, monkeypatch):
    words = shlex.split(line, comments=True)
    at = next(number for number, word in enumerate(words) if word.startswith("docs/"))
    script = ROOT / words[at]
    monkeypatch.syspath_prepend(str(script.parent))
    options = getattr(import_module(script.stem), "Options", None)
    if options is None:
        assert len(words) == at + 1 or words[at] == "docs/make_page_image.py", f"{page}: {line}"
    else:
        parse(options, "script", None, words[at + 1 :])


def test_the_guides_hold_lines_of_scripts():
    assert len(SCRIPT_LINES) > 25


def test_the_words_of_a_page_name_no_flag_that_is_none(reference_pages):
    known = {"--help", "--version"}
    for module in MODULES:
        for action in reference_pages.flags(import_module(module))._actions:
            known |= set(action.option_strings)
    others = {
        "--nproc-per-node", "--nworkers", "--nthreads", "--no-deps", "--num-envs",  # of torchrun, dask, pip and CleanRL
    }  # fmt: skip
    for script in [*(ROOT / "docs").glob("*.py"), *(ROOT / "docs" / "scoring").glob("*.py")]:
        fields = re.findall(r"^    ([a-z_]+): \w", script.read_text(encoding="utf-8"), re.MULTILINE)
        others |= {f"--{no}{field.replace('_', '-')}" for field in fields for no in ("", "no-")}
    count = 0
    for page in PAGES:
        prose = re.sub(
            r"^ {4,}[^\n]*$|^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
        )
        for code in re.findall(r"`([^`\n]+)`", prose):
            count += 1
            try:
                words = shlex.split(code)
            except ValueError:
                continue
            if len(words) > 1 and words[0] == "python" and words[1].endswith(".py"):
                continue  # a program of its own
            for word in words:
                if not word.startswith("--"):
                    continue
                flag = word.partition("=")[0].rstrip(",;")
                begins = flag.endswith(("*", ".")) and any(name.startswith(flag.rstrip("*.")) for name in known)
                assert flag in known | others or begins, f"{page.relative_to(ROOT)}: {code}"
    assert count > 1500
