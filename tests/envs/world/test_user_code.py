import numpy as np
import pytest

from envs.drivers.builtin import StraightDriver
from envs.world.user_code import UserCodeError, errors_of
from marssim.base.command.run import MISTAKES


class Mine:
    pass


@pytest.mark.parametrize(
    "error", [ValueError("no\nsuch"), FloatingPointError(), ImportError("cupy"), OSError(2, "gone")]
)
def test_what_others_raise_is_no_mistake_on_the_command_line(error):
    with pytest.raises(UserCodeError, match=f":Mine raised {type(error).__name__}") as raised, errors_of(Mine()):
        raise error
    assert raised.value.__cause__ is error and not isinstance(raised.value, MISTAKES)


def test_the_projects_own_mistakes_stay_what_they_are():
    with pytest.raises(ValueError, match=r"^policy$"), errors_of(StraightDriver()):
        raise ValueError("policy")


def test_ctrl_c_is_nobodys_fault():
    with pytest.raises(KeyboardInterrupt), errors_of(Mine()):
        raise KeyboardInterrupt


def test_what_is_no_error_passes():
    with errors_of(Mine()):
        total = np.sum([1, 2])
    assert total == 3
