import numpy as np

from envs.drivers.training_courses import TrainingCourses


def test_each_scene_has_its_own_rocks(make_env):
    env = TrainingCourses(make_env(), (0.05, 0.2), crossings=1)
    abundances = []
    env.env.reset = lambda seed=None, options=None: abundances.append(options["k"])
    env.reset(seed=1)
    env.reset()
    env.reset(seed=1)
    env.reset(options={"k": 0.3})
    assert 0.05 <= abundances[0] <= 0.2 and abundances[0] == abundances[2] != abundances[1] and abundances[3] == 0.3


def test_a_scene_is_crossed_to_and_fro_and_then_another(make_env):
    inner = make_env()
    env = TrainingCourses(inner, (0.05, 0.1), crossings=3)
    env.reset(seed=1)
    courses = [inner.course]
    for _ in range(3):
        env.reset()
        courses.append(inner.course)
    first, second, third, fourth = courses
    assert first.scene is second.scene is third.scene is not fourth.scene
    np.testing.assert_array_equal(second.goal, first.start[:2])
    np.testing.assert_array_equal(third.goal, first.goal)
    assert first.start[2] != third.start[2]
    env.reset(seed=1)  # a seed asks for its own scene at once
    np.testing.assert_array_equal(inner.course.start, first.start)
