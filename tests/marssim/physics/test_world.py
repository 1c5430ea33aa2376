import numpy as np
import pytest

pytest.importorskip("pybullet")

from marssim.physics.world import PhysicsWorld


def cast(world, x, y):
    hits = world.bullet.rayTestBatch(
        [[a, b, 5.0] for a, b in zip(x, y)], [[a, b, -5.0] for a, b in zip(x, y)], physicsClientId=world.client
    )
    return np.array([hit[3][2] for hit in hits]), np.array([hit[0] for hit in hits])


def test_ground_and_rocks_stand_where_the_scene_has_them(make_scene):
    balls = [(1.5, 1.0, 0.0, 0.25), (-1.0, -2.0, 0.3, 0.4)]
    scene = make_scene(lambda x, y: 0.3 * x + 0.1 * np.sin(y) + 0.7, balls=balls)
    with PhysicsWorld(scene) as world:
        x, y = np.random.default_rng(0).uniform(-3.9, 3.9, (2, 300))
        z, body = cast(world, x, y)
        expected = np.full(300, -np.inf)
        for bx, by, bz, r in balls:
            inside = np.hypot(x - bx, y - by) < r
            expected[inside] = bz + np.sqrt(r**2 - np.hypot(x - bx, y - by)[inside] ** 2)
        ground = scene.terrain.height_at(x, y)
        np.testing.assert_allclose(z, np.maximum(ground, expected), atol=0.03)
        assert np.abs(z - ground)[body == 0].max() < 2e-3
        _, hit = cast(world, [-1.0, 1.5], [-2.0, 1.0])
        assert hit[0] in world.obstacles and hit[1] not in world.obstacles


@pytest.mark.parametrize(("half", "cell", "apart"), [(15.0, 0.1, 1), (7.0, 0.05, 2)])
def test_wide_ground_is_thinned_to_a_tenth_of_a_metre_and_no_further(make_scene, half, cell, apart):
    """The ripples are two nodes long, so that a node left out is a ripple lost."""
    scene = make_scene(lambda x, y: 0.05 * np.cos(np.pi * x / (apart * cell)), half=half, cell=cell)
    assert len(scene.terrain.fine.heights) > 260
    nodes = np.arange(-20, 20) * apart * cell
    with PhysicsWorld(scene) as world:
        z, _ = cast(world, nodes + 1e-4, np.full(40, 0.3))
    assert np.abs(z - scene.terrain.height_at(nodes, np.zeros(40))).max() < 2e-3


def test_a_ball_falls_as_on_mars(make_scene):
    """The distance fallen in the second half second less that in the first is g (0.5 s)^2, with g = 3.72076 m/s2."""
    with PhysicsWorld(make_scene(half=2.0)) as world:
        p, client = world.bullet, world.client
        ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1, physicsClientId=client)
        body = p.createMultiBody(1.0, ball, basePosition=[0, 0, 10.0], physicsClientId=client)
        p.changeDynamics(body, -1, linearDamping=0, physicsClientId=client)
        heights = [10.0]
        for _ in range(2):
            world.step(0.5)
            heights.append(p.getBasePositionAndOrientation(body, physicsClientId=client)[0][2])
    assert -np.diff(heights, 2)[0] / 0.5**2 == pytest.approx(3.72076, rel=1e-6)


def test_time_is_carried_over_between_steps(make_scene):
    with PhysicsWorld(make_scene(half=2.0)) as world:
        for _ in range(24):
            world.step(0.01)
        assert world.time == pytest.approx(0.24, abs=1 / 240)


def test_a_world_can_be_closed_twice_and_refuses_steps_then(make_scene):
    world = PhysicsWorld(make_scene(half=2.0))
    world.close()
    world.close()
    with pytest.raises(RuntimeError, match="closed"):
        world.step(0.1)
    with pytest.raises(ValueError, match="time_step"):
        PhysicsWorld(make_scene(half=2.0), time_step=0.0)
