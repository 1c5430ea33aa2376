"""Settings of the navigator that cannot work are refused by name."""

import numpy as np
import pytest

from marssim.base.camera import NATECAM
from nav.config import NavigatorConfig, RiskLevel
from nav.ground.elevation import ElevationConfig
from nav.ground.hidden_drops import HiddenDropConfig
from nav.ground.traversability import TraversabilityConfig
from nav.navigator import Navigator
from nav.path.planner_config import PlannerConfig


@pytest.mark.parametrize(
    ("config", "values", "message"),
    [
        (NavigatorConfig, {"step_time": -1.0}, r"^step_time must lie in \[0.001, 10000\], got -1$"),
        (NavigatorConfig, {"step_time": 0.0}, "^step_time must lie in"),
        (NavigatorConfig, {"step_time": float("nan")}, "^step_time must lie in"),
        (NavigatorConfig, {"max_recoveries": 2.0}, "^max_recoveries must be a whole number of at least 0, got 2.0$"),
        (NavigatorConfig, {"closed_steps": 0}, "^closed_steps must be a whole number of at least 1, got 0$"),
        (NavigatorConfig, {"risk_after": 0}, "^risk_after must be a whole number of at least 1, got 0$"),
        (NavigatorConfig, {"slip_steps": 0}, "^slip_steps must be a whole number of at least 1, got 0$"),
        (NavigatorConfig, {"seen_share": 1.5}, "^seen_share must lie in"),
        (NavigatorConfig, {"planner": PlannerConfig(coarse=101)}, "^planner.coarse must be at most a quarter"),
        (RiskLevel, {"step": float("nan"), "slope_deg": 20.0, "margin_share": 0.5}, "^step must lie in"),
        (TraversabilityConfig, {"step_blocked": float("nan")}, "^step_blocked must be more than 0.08"),
        (
            TraversabilityConfig,
            {"step_blocked": 0.08},
            "^step_blocked must be more than 0.08, up to which it costs nothing",
        ),
        (TraversabilityConfig, {"slope_blocked_deg": 6.0}, "^slope_blocked_deg must be more than 6"),
        (TraversabilityConfig, {"roughness_blocked": 0.0}, "^roughness_blocked must be more than 0"),
        (TraversabilityConfig, {"near_cost": -1.0}, "^near_cost must be at least 0"),
        (
            NavigatorConfig,
            {"risk_levels": None},
            r"^risk_levels must be a tuple of RiskLevel, \(\) for none, got None$",
        ),
        (NavigatorConfig, {"risk_levels": (0.2, 26.0)}, "^risk_levels must be a tuple of RiskLevel"),
        (NavigatorConfig, {"planner": {"margin": 0.1}}, "^planner must be a PlannerConfig, got {'margin': 0.1}$"),
        (NavigatorConfig, {"step_time": None}, "^step_time must be a number, got None$"),
        (PlannerConfig, {"margin": "wide"}, "^margin must be a number, got 'wide'$"),
        (PlannerConfig, {"spacing": 0.0}, "^spacing must lie in"),
        (PlannerConfig, {"commit": 0.0}, r"^commit must lie in \[0.01, 1000\], got 0$"),
        (PlannerConfig, {"lookahead": 0.5}, "^commit must be at most lookahead and arc_length, .* got 0.8 and 0.5$"),
        (PlannerConfig, {"arc_length": 0.7}, "^commit must be at most lookahead and arc_length, .* got 0.8 and 0.7$"),
        (PlannerConfig, {"turns": 0}, "^turns must be a whole number of at least 1"),
        (PlannerConfig, {"arcs": 31.0}, "^arcs must be a whole number of at least 1, got 31.0$"),
        (PlannerConfig, {"coarse": True}, "^coarse must be a whole number"),
        (PlannerConfig, {"margin": -0.1}, "^margin must be at least 0"),
        (ElevationConfig, {"columns": 0}, "^columns must be a whole number of at least 1"),
        (ElevationConfig, {"size": float("inf")}, "^size must lie in"),
        (ElevationConfig, {"min_confidence": 1.5}, "^min_confidence must lie in"),
        (ElevationConfig, {"max_range": 0.4}, "^max_range must be at least 0.5"),
        (ElevationConfig, {"max_range": float("nan")}, "^max_range must be at least 0.5"),
        (HiddenDropConfig, {"least_drop": -1.0}, "^least_drop must be at least 0, got -1"),
    ],
)
def test_a_setting_that_cannot_work_is_named(config, values, message):
    with pytest.raises(ValueError, match=message):
        config(**values)


def test_limits_themselves_are_allowed():
    assert ElevationConfig(max_range=np.inf).max_range == np.inf
    NavigatorConfig(elevation=ElevationConfig(cell=0.05, size=1.4), planner=PlannerConfig(coarse=7))


def test_the_coarsest_distance_field_that_is_allowed_works():
    navigator = Navigator(config=NavigatorConfig(planner=PlannerConfig(coarse=100)))
    rig = NATECAM.resized(32, 32)
    command = navigator.step(np.full((32, 32), np.nan), None, rig, np.eye(4), np.array([8.0, 0.0]))
    assert np.isfinite([command.speed, command.yaw_rate]).all()
