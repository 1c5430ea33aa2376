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
def test_an_exception_of_a_users_class_becomes_a_user_code_error(error):
    with pytest.raises(UserCodeError, match=f":Mine raised {type(error).__name__}") as raised, errors_of(Mine()):
        raise error
    assert raised.value.__cause__ is error and not isinstance(raised.value, MISTAKES)


def test_exceptions_of_the_projects_classes_pass_unchanged():
    with pytest.raises(ValueError, match=r"^policy$"), errors_of(StraightDriver()):
        raise ValueError("policy")


def test_ctrl_c_in_a_users_class_passes_unchanged():
    with pytest.raises(KeyboardInterrupt), errors_of(Mine()):
        raise KeyboardInterrupt


def test_without_an_exception_nothing_is_raised():
    with errors_of(Mine()):
        total = np.sum([1, 2])
    assert total == 3
