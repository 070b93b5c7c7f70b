"""Adding samples: what is rendered next, and that nothing of what is there is lost."""

import numpy as np
import pytest

from addon.compare.cycles import sequential
from addon.compare.cycles.rendering import Rendering


@pytest.mark.parametrize(
    ("samples", "batches", "shortage", "most", "plan"),
    [
        (8, 8, 1.5, 1 << 16, (8, 4, 1)),
        (8, 8, 4.0, 1 << 16, (8, 24, 1)),
        (8, 8, 1000.0, 1 << 16, (16, 28, 2)),
        (8, 8, 1000.0, 80, (8, 2, 1)),
        (8, 8, 1000.0, 64, None),
        (8, 8, 0.9, 1 << 16, None),
        (8, 9, 8.0, 1 << 16, (8, 63, 1)),
    ],
)
def test_plan_reaches_what_is_wanted_with_few_batches(samples, batches, shortage, most, plan):
    planned = sequential.plan_batches(samples, batches, shortage, most)
    assert planned == plan
    if planned:
        reached = planned.samples * (batches // planned.merged + planned.batches)
        assert reached >= min(samples * batches * min(shortage, sequential.GROWTH), most)


def test_joined_renderings_have_the_mean_of_all_samples(rng):
    before = Rendering({"Combined": rng.random((8, 3, 5, 4)).astype(np.float32)}, 2.0)
    more = Rendering({"Combined": rng.random((6, 3, 5, 4)).astype(np.float32)}, 3.0)
    joined = sequential.join_renderings(before, more, merged=4)
    batches = joined.passes["Combined"]
    assert (batches.shape, batches.dtype, joined.seconds) == ((8, 3, 5, 4), np.float32, 5.0)
    expected = (before.passes["Combined"].sum(axis=0) + 4 * more.passes["Combined"].sum(axis=0)) / (8 + 4 * 6)
    # float32: the means of four numbers below 1 are rounded once.
    np.testing.assert_allclose(batches.mean(axis=0), expected, atol=1e-6)


def test_looks_share_the_probability_of_a_false_alarm():
    any_alarm = 1 - (1 - sequential.LOOK_SIGNIFICANCE) ** sequential.LOOKS
    assert any_alarm == pytest.approx(0.01, rel=1e-9)
