"""The training of the example: that it can be repeated, and that its drives come with their mirror images."""

from __future__ import annotations

import importlib
import shutil

import numpy as np
import pytest

from tests.support import ROOT

pytest.importorskip("cma")

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def train(tmp_path_factory):
    """A copy: what is compiled is kept beside the file, under the name by which it was imported."""
    folder = tmp_path_factory.mktemp("training")
    shutil.copy(ROOT / "docs/examples/learned_follower/train.py", folder / "copy_of_train.py")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        module = importlib.import_module("copy_of_train")
        module.LASTS, module.DRIVES = 100, 1
        yield module


def test_training_again_from_the_same_seed_gives_the_same_weights(train, tmp_path):
    first, again, other = (train.learn(seed, 3, tmp_path / "curve.csv") for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert not np.array_equal(first, train.beginning(np.random.default_rng(1)))  # it has learned something


def test_a_proportional_law_costs_as_much_on_the_mirror_image_of_a_drive(train):
    random = np.random.default_rng(0)
    weights = train.beginning(random)
    (w0, b0), (w1, b1) = train.layers(weights)
    w0[2:], w1[2:], w1[:2, 2:] = 0.0, 0.0, 0.0
    drive, mirrored = train.episodes(random, 1)
    without = [(path, starts, 0.0, seed) for path, starts, _, seed in (drive, mirrored)]
    costs = [train.drive(*one, w0, b0, w1, b1) for one in without]
    assert costs[0] == pytest.approx(costs[1], rel=1e-3)
    assert np.array_equal(drive[0][1], -mirrored[0][1])
