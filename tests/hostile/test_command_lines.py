"""Random and hostile values of every flag of every command are taken, or refused in one line that names the flag."""

import re
import shutil
from contextlib import suppress
from dataclasses import fields, is_dataclass
from math import inf

import pytest
from command_lines import CONFIGS, VALUES, config_of, flags_of, parser_of, with_values
from hypothesis import given
from hypothesis import strategies as st
from oracle import IN_PROCESSES, cases, count, judge, many, only_in_make_hostile, rng_of
from small_runs import RUNS, left_over

from marssim.base.command.limits import LARGEST
from marssim.base.command.listing import COMMANDS

EXTREME = st.sampled_from(("nan", "inf", "-inf", "1e300", "-1e300"))
HOSTILE = EXTREME | st.sampled_from(VALUES) | st.floats().map(repr) | st.integers().map(str) | st.text(max_size=8)
SMALL = ("2", "3", "0.5", "0.01", "10", "25")  # values that many flags take
TAKEN = {  # commands that are run with hostile flags, and flags that rightly take long
    "marssim.generate": ("--pairs", "--views-per-scene", "--rig.width", "--rig.height", "--size", "--horizon"),
    "marssim.export": (), "m3depth.predict": ("--view",), "m3depth.evaluate": (), "m3depth.train": ("--max-steps",),
}  # fmt: skip
# refusals of the words at the start of a line as a whole
NUMBER_OF_WORDS = (
    "a value before all --flags",
    "needs a value",
    "give a left and a right image",
    "name a folder",
    "two drives need --out",
)
UNKNOWN = "--xyzzy"  # no flag of any command, and similar to none


def as_printed(word: str) -> str:
    """Return a word as stderr shows it, which escapes what is no character."""
    return word.encode(errors="backslashreplace").decode()


def check_meant(config):
    """Check that no number of a config that was taken is NaN, larger than a number can be meant, or newly infinite."""
    for field in fields(config) if is_dataclass(config) else ():
        value = getattr(config, field.name)
        check_meant(value)
        unlimited = field.default == inf or (isinstance(field.default, tuple) and inf in field.default)
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, float) and not (unlimited and number == inf):
                assert abs(number) <= LARGEST, f"{field.name} took {number}"


def test_every_command_is_attacked():
    assert set(CONFIGS) == {f"{package}.{name}" for package, names in COMMANDS.items() for name in names}


@pytest.mark.parametrize("command", CONFIGS)
def test_the_least_command_line_is_taken_and_every_flag_is_one(command):
    """Else all attacks would end at the same refusal.

    All flags stand on one line, with one that the command does not have. Flags whose value is refused are taken away
    one by one, until that one is named: no other is unknown.
    """
    parser_of(command)(CONFIGS[command][1])
    flags = {flag: ["1"] * abs(width) for flag, width in flags_of(config_of(command))}
    while True:
        with pytest.raises(ValueError) as refusal:
            parser_of(command)(with_values(command, [*flags.items(), (UNKNOWN, [])]))
        if "unknown option" in str(refusal.value):
            break
        named = re.match(r"(?:--|`)([\w.-]+)", str(refusal.value))
        assert named, refusal.value
        del flags[f"--{named[1]}"]
    assert str(refusal.value) == f"unknown option {UNKNOWN}"
    assert len(flags) >= len(list(flags_of(config_of(command)))) / 2


@pytest.mark.parametrize("command", CONFIGS)
@given(data=st.data())
@many
def test_a_command_line_is_taken_or_refused_in_one_line(command, data, capsys, tmp_path_factory):
    flags = data.draw(st.lists(st.sampled_from(list(flags_of(config_of(command)))), min_size=1, max_size=2))
    values = []
    for flag, width in flags:
        number = data.draw(st.integers(0, 3)) if width < 0 else width
        values.append((flag, [data.draw(HOSTILE) for _ in range(number)]))
    count(command, "flags")
    taken: list[object] = []
    words = [word for _, drawn in values for word in drawn]
    names = [flag for flag, _ in flags if flag]
    if any(word.startswith("-") for word in words):  # may be taken for an option of its own
        names += ["unknown option", " to no option"]
    if "" in dict(flags):
        names += [*(word for word in words if word), CONFIGS[command][1][0], *NUMBER_OF_WORDS]
    judge(lambda: taken.append(parser_of(command)(with_values(command, values))), capsys, *names)
    for config in taken:
        check_meant(config)


@only_in_make_hostile
def test_a_command_line_that_is_taken_is_done_or_refused_in_one_line(server, inputs, tmp_path):
    """What is wrong with a value may show only when the work has begun."""
    rng, tried = rng_of("taken lines"), 0
    for number in cases(0.3, 40 * IN_PROCESSES):
        command = rng.choice(list(TAKEN))
        run, out = RUNS[command], tmp_path / str(number)
        flags = [flag for flag in flags_of(config_of(command)) if flag[0] not in ("", "--out", *TAKEN[command])]
        line, names = run.line(out, inputs), [str(out), *map(str, inputs.values())]
        for flag, width in rng.sample(flags, 2):
            words = [rng.choice((*VALUES, *SMALL)) for _ in range(rng.randint(1, 3) if width < 0 else width)]
            line += [flag, *words]
            names += [flag, *(f"{as_printed(word)}:" for word in words)]
        with suppress(ValueError):
            parser_of(command)(line)
            ended = server.run(run.entry, line)
            ended.check(*names)
            count(command, "taken line")
            assert not left_over(out), line
            tried += 1
        shutil.rmtree(out, ignore_errors=True)
        if tried >= IN_PROCESSES:
            break
    assert tried > 0
