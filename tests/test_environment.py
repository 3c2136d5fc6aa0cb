"""The swarm as a PettingZoo environment: PettingZoo's own tests, and what a policy sees and does."""

from __future__ import annotations

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test

from phalanx.errors import UsageError
from phalanx.lab.environment import OWN, SwarmEnv
from phalanx.scenarios.file import find_scenario
from phalanx.scenarios.own import find_attacks

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")  # PettingZoo's own
SMALL = find_scenario("flock-12").with_options(robots=6, duration_s=8.0)


def towards(seen):
    """A scripted policy: to the goal, gently."""
    return np.clip(0.02 * seen[:2] - 0.2 * seen[2:4], -5, 5)


def flown(env: SwarmEnv, policy, seed: int = 0) -> float:
    """The mean reward of all agents together."""
    seen, _ = env.reset(seed=seed)
    total = 0.0
    while env.agents:
        seen, rewards, _, _, _ = env.step({agent: policy(seen[agent]) for agent in env.agents})
        total += sum(rewards.values())
    return total / len(env.possible_agents)


@pytest.mark.filterwarnings("error")
def test_it_passes_pettingzoo_s_own_tests():
    parallel_api_test(SwarmEnv(SMALL), num_cycles=40)
    parallel_seed_test(lambda: SwarmEnv(SMALL), num_cycles=8)


def test_a_policy_that_goes_to_the_goal_is_rewarded_for_the_metres_that_it_came_nearer():
    env = SwarmEnv(SMALL)
    env.reset()
    before_m = np.hypot(*(env.run.positions_m - SMALL.goal_m).T)
    gained = flown(env, towards)
    after_m = np.hypot(*(env.run.positions_m - SMALL.goal_m).T)
    assert gained == pytest.approx((before_m - after_m).mean(), abs=0.05)
    assert gained > 1 > abs(flown(SwarmEnv(SMALL), lambda seen: np.zeros(2)))


def test_who_touches_another_pays_for_it():
    close = SMALL.with_options(spacing_m=0.5)
    assert flown(SwarmEnv(close), lambda seen: np.zeros(2)) < -30


def test_an_observation_is_what_was_said_seen_from_the_own_place():
    env = SwarmEnv(SMALL, heard=3)
    env.reset()
    for _ in range(12):
        seen, *_ = env.step({})
    at = env.run.positions_m
    for agent, told in seen.items():
        i = int(agent.removeprefix("robot_")) - 1
        assert told[:2] == pytest.approx(np.array(SMALL.goal_m) - at[i], abs=0.01)
        nearest = sorted(np.hypot(*(at - at[i]).T))[1:4]
        others = told[OWN:].reshape(3, 5)
        assert others[:, 0].tolist() == [1, 1, 1]
        assert np.hypot(others[:, 1], others[:, 2]) == pytest.approx(nearest, abs=0.05)


def test_a_liar_is_nobody_s_agent_and_lies_to_all():
    lied = SwarmEnv(SMALL.with_options(attacks=find_attacks(["hijack:robot=2,at=1"])))
    assert "robot_2" not in lied.possible_agents
    assert len(lied.possible_agents) == 5
    lied.reset(seed=7)
    for _ in range(16):
        seen, *_ = lied.step({})
    honest = SwarmEnv(SMALL)
    honest.reset(seed=7)
    for _ in range(16):
        seen_2, *_ = honest.step({})
    assert any(not np.allclose(seen[agent], seen_2[agent], atol=1.0) for agent in seen)


@pytest.mark.parametrize("action", [[0.0], [np.nan, 0.0], [np.inf, 0.0], "ab"])
def test_what_is_no_action_is_refused(action):
    env = SwarmEnv(SMALL)
    with pytest.raises(UsageError, match="step before reset"):
        env.step({})
    env.reset()
    with pytest.raises((UsageError, ValueError)):
        env.step({"robot_1": action})
    with pytest.raises(UsageError, match="robot_99"):
        env.step({"robot_99": [0.0, 0.0]})
    env.step({"robot_1": [1e9, -1e9]})
