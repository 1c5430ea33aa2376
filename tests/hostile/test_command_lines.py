"""Random and hostile values of every flag of every command are taken, or refused in one line that names the flag."""

from dataclasses import fields, is_dataclass
from math import inf

import pytest
from command_lines import CONFIGS, VALUES, config_of, flags_of, parser_of, with_values
from hypothesis import given
from hypothesis import strategies as st
from oracle import count, judge, many

from marssim.base.command.limits import LARGEST
from marssim.base.command.listing import COMMANDS

EXTREME = st.sampled_from(("nan", "inf", "-inf", "1e300", "-1e300"))
HOSTILE = EXTREME | st.sampled_from(VALUES) | st.floats().map(repr) | st.integers().map(str) | st.text(max_size=8)


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
    """Else all attacks would end at the same refusal."""
    parser_of(command)(CONFIGS[command][1])
    for flag, width in flags_of(config_of(command)):
        try:
            parser_of(command)(with_values(command, [(flag, ["1"] * abs(width))]))
        except ValueError as error:
            assert "unknown option" not in str(error), f"{flag}: {error}"


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
        names.append("unknown option")
    if "" in dict(flags):
        names += [word for word in words if word] + CONFIGS[command][1][:1]
    judge(lambda: taken.append(parser_of(command)(with_values(command, values))), capsys, *names)
    for config in taken:
        check_meant(config)
