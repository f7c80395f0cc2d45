"""The transform buffer gives what tf2's own gives, where that is installed, and what plain 4 x 4 matrices give."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import system_ros
from tempog.errors import TransformError
from tempog.ros.messages import StampedTransform
from tempog.ros.transforms import TransformBuffer

FRAMES = ["map", "odom", "base", "laser", "rear"]


def _random_turn(chance: random.Random) -> tuple[float, float, float, float]:
    parts = [chance.gauss(0, 1) for _ in range(4)]
    norm = math.sqrt(sum(part**2 for part in parts))
    x, y, z, w = (part / norm for part in parts)
    return x, y, z, w


def _world(seed: int) -> list[tuple[StampedTransform, bool]]:
    """A tree of five frames with transforms in any order; some edges static, some turned the other way round."""
    chance = random.Random(seed)
    names = FRAMES[:]
    chance.shuffle(names)
    made = []
    for k in range(1, len(names)):
        parent, child = names[chance.randrange(k)], names[k]
        static = chance.random() < 0.3
        stamps = [chance.randrange(0, 4_000_000_000) for _ in range(1 if static else chance.randint(2, 8))]
        for stamp in stamps:
            moved = (chance.uniform(-5, 5), chance.uniform(-5, 5), chance.uniform(-1, 1))
            made.append((StampedTransform(stamp, parent, child, moved, _random_turn(chance)), static))
    chance.shuffle(made)
    return made


@pytest.mark.skipif(
    not system_ros.has("tf2_ros", "rospy"), reason="tf2_ros is not installed (Debian: python3-tf2-ros)"
)
@pytest.mark.parametrize("seed", range(8))
def test_answers_are_those_of_tf2(seed: int) -> None:
    made = _world(seed)
    chance = random.Random(1000 + seed)
    questions = [
        (chance.choice(FRAMES), chance.choice(FRAMES), chance.randrange(1, 4_000_000_000)) for _ in range(200)
    ]
    asked = {"transforms": [(*one, static) for one, static in made], "questions": questions}
    answers = system_ros.ask("tf2_core.py", asked)
    buffer = TransformBuffer(extrapolate_s=0.0)
    for one, static in made:
        buffer.add(one, static=static)
    n_known = 0
    for (fixed, frame, stamp_ns), theirs in zip(questions, answers, strict=True):
        try:
            moved, turned = buffer.poses(fixed, frame, [stamp_ns])
        except TransformError:
            assert theirs is None
            continue
        assert theirs is not None
        n_known += 1
        np.testing.assert_allclose(moved[0], theirs[0], atol=1e-9)
        assert abs(float(turned[0] @ np.array(theirs[1]))) == pytest.approx(1, abs=1e-9)
    assert n_known > 20


def _matrix(x: float, y: float, theta: float) -> np.ndarray:
    cos, sin = math.cos(theta), math.sin(theta)
    return np.array([[cos, -sin, x], [sin, cos, y], [0, 0, 1]])


numbers = st.floats(-10, 10, allow_nan=False)
turns = st.floats(-3, 3, allow_nan=False)
poses = st.tuples(numbers, numbers, turns)


@settings(max_examples=200, deadline=None)
@given(poses, poses, poses, st.floats(0, 1))
def test_chains_in_the_plane_are_products_of_matrices(start: tuple, stop: tuple, mount: tuple, share: float) -> None:
    def transform(stamp_ns: int, parent: str, child: str, pose: tuple) -> StampedTransform:
        x, y, theta = pose
        turned = (0.0, 0.0, math.sin(theta / 2), math.cos(theta / 2))
        return StampedTransform(stamp_ns, parent, child, (x, y, 0.0), turned)

    buffer = TransformBuffer()
    buffer.add(transform(0, "base", "laser", mount), static=True)
    buffer.add(transform(0, "map", "base", start))
    buffer.add(transform(10**9, "map", "base", stop))
    stamp = round(share * 1e9)
    moved, turned = buffer.poses("map", "laser", [stamp])
    step = math.remainder(stop[2] - start[2], 2 * math.pi)
    x, y = (a + stamp / 1e9 * (b - a) for a, b in zip(start[:2], stop[:2], strict=True))
    wanted = _matrix(x, y, start[2] + stamp / 1e9 * step) @ _matrix(*mount)
    np.testing.assert_allclose(moved[0, :2], wanted[:2, 2], atol=1e-6)
    theta = 2 * math.atan2(turned[0, 2], turned[0, 3])
    assert math.remainder(theta - math.atan2(wanted[1, 0], wanted[0, 0]), 2 * math.pi) == pytest.approx(0, abs=1e-6)
    back, _ = buffer.poses("laser", "map", [stamp])
    np.testing.assert_allclose(back[0, :2], np.linalg.inv(wanted)[:2, 2], atol=1e-6)
