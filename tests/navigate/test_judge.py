"""The seat of a judge of sensors: what it may do to an update; a rewind gives the verdicts of the order of time."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from common.messages import Frame
from shore.navigation.estimate import Estimate
from shore.navigation.filter_bank import Bank, Batch, Moment
from shore.navigation.filter_registry import REGISTRY, build_filter
from shore.navigation.filters import Filter, FilterState
from shore.navigation.judge import Evidence, Judge, Verdict
from shore.navigation.measurements import Measurement, Position, TrueHeading
from shore.navigation.noise.noise_rule import Channel
from shore.navigation.numbers import Number
from shore.navigation.sensor_facts import FilterFacts
from shore.navigation.timeline import Timeline
from shore.pipeline import Pipeline
from tests.navigate.voyages import BOAT, state_of

S = 1_000_000_000
CHANNELS = {"g.east": Channel(4.0), "g.north": Channel(4.0), "c.heading": Channel(0.01)}
FACTS = FilterFacts(CHANNELS)


class Strict(NamedTuple):
    """Rejects what lies beyond five sigma, and a sensor for good after three such scalars."""

    strikes: tuple[tuple[str, int], ...] = ()
    heard: tuple[tuple[int, str, bool], ...] = ()

    def hear(self, evidence: Evidence) -> Verdict:
        sensor = evidence.channel.partition(".")[0]
        count = dict(self.strikes).get(sensor, 0)
        is_far = bool(evidence.innovation**2 > 25.0 * (evidence.prior_variance + evidence.variance))
        is_rejected = is_far or count >= 3
        strikes = tuple(sorted({**dict(self.strikes), sensor: count + is_far}.items()))
        after = Strict(strikes, (*self.heard, (evidence.t_ns, evidence.channel, is_rejected)))
        return Verdict(after, None if is_rejected else 1.0)


class Always(NamedTuple):
    """The same verdict on everything."""

    scale: Number | None

    def hear(self, evidence: Evidence) -> Verdict:
        del evidence
        return Verdict(self, self.scale)


def readings() -> list[Measurement]:
    """A minute at rest; the receiver lies 200 m off in the middle of it, and is right again afterwards."""
    rng = np.random.default_rng(7)
    fixes: list[Measurement] = []
    for k in range(1, 60):
        east = 200.0 if 20 <= k < 23 else 0.0
        fixes.append(Position(k * S, "g", east + float(rng.normal()), float(rng.normal())))
        fixes.append(TrueHeading(k * S, "c", 0.1 * float(rng.normal())))
    return fixes


def end_of(name: str, measured: list[Measurement], judge: Judge | None) -> Moment:
    timeline = Timeline(Bank([build_filter(name, FACTS, judge=judge)], has_compass=True), None)
    for each in measured:
        timeline.push(Batch(each.t_ns, "b", (each,), ()))
    return timeline.at(measured[-1].t_ns)


def judge_of(moment: Moment) -> Strict:
    judge = state_of(moment).judge
    assert isinstance(judge, Strict)
    return judge


@pytest.mark.parametrize("name", sorted(REGISTRY))
def test_a_rewind_gives_the_verdicts_of_the_order_of_time(name: str) -> None:
    """Up to four seconds late and shuffled; `fuzzy` filters its opening again meanwhile, and each is heard once."""
    ordered = readings()
    rng = np.random.default_rng(3)
    arrival = [*ordered[:2], *sorted(ordered[2:-1], key=lambda each: each.t_ns + 2 * S * rng.random()), ordered[-1]]
    assert arrival != ordered
    expected, found = end_of(name, ordered, Strict()), end_of(name, arrival, Strict())
    assert judge_of(found) == judge_of(expected)
    assert np.array_equal(state_of(found).x, state_of(expected).x)
    assert np.array_equal(state_of(found).P, state_of(expected).P)
    heard = [(t_ns, channel) for t_ns, channel, _ in judge_of(found).heard]
    assert heard == sorted(set(heard), key=lambda item: (item[0], list(CHANNELS).index(item[1])))
    assert [t_ns for t_ns, channel, is_rejected in judge_of(found).heard if channel == "g.east" and is_rejected] == [
        k * S for k in range(20, 60)
    ]


def test_a_rejected_sensor_moves_nothing() -> None:
    judged, blind = end_of("ukf", readings(), Strict()), end_of("ukf", readings(), None)
    assert abs(float(state_of(judged).x[0])) < 5.0
    only_headings = [each for each in readings() if isinstance(each, TrueHeading) or each.t_ns < 20 * S]
    without = state_of(end_of("ukf", only_headings, None))
    assert state_of(judged).x[4] == without.x[4]
    assert float(state_of(judged).P[0, 0]) > 10.0 * float(state_of(blind).P[0, 0])


def started(judge: Judge | None, facts: FilterFacts = FACTS, name: str = "fuzzy") -> Filter:
    each = build_filter(name, facts, judge=judge)
    each.start(np.zeros(5), np.diag([4.0, 4.0, 1.0, 1.0, 0.1]))
    each.predict(1.0, None)
    return each


def after(each: Filter) -> FilterState:
    for k in range(5):
        each.update(Position(k, "g", 1.0 + k, -1.0))
        each.update(TrueHeading(k, "c", 0.2))
        each.predict(1.0, None)
    return each.estimate


@pytest.mark.parametrize("name", sorted(REGISTRY))
def test_a_judge_that_passes_all_changes_no_bit(name: str) -> None:
    judged, free = after(started(Always(1.0), name=name)), after(started(None, name=name))
    assert np.array_equal(judged.x, free.x)
    assert np.array_equal(judged.P, free.P)
    assert judged.noise == free.noise


def test_a_rejected_scalar_teaches_the_noise_rule_nothing() -> None:
    each = started(Always(None))
    before = each.estimate
    each.update(Position(0, "g", 1.0, -1.0))
    assert each.estimate.x is before.x
    assert each.estimate.P is before.P
    assert each.estimate.noise == {}


def test_a_scale_is_a_factor_on_r() -> None:
    """As a filter whose sensors are that much worse."""
    worse = FilterFacts({name: Channel(9.0 * each.initial_variance) for name, each in CHANNELS.items()})
    scaled, expected = after(started(Always(9.0), name="ukf")), after(started(None, worse, name="ukf"))
    assert scaled.x == pytest.approx(expected.x, abs=1e-12)
    assert np.allclose(scaled.P, expected.P, rtol=1e-12, atol=0.0)
    assert scaled.noise["g.east"].nis == pytest.approx(expected.noise["g.east"].nis)
    assert scaled.noise["g.east"].variance == CHANNELS["g.east"].initial_variance


def test_it_knows_what_the_filter_knew() -> None:
    heard: list[Evidence] = []

    class Listener(NamedTuple):
        def hear(self, evidence: Evidence) -> Verdict:
            heard.append(evidence)
            return Verdict(self, 1.0)

    each = started(Listener(), name="ukf")
    before = each.estimate
    each.update(Position(7, "g", 3.0, -1.0))
    east, north = heard
    assert east[:5] == (7, "g.east", 3.0, float(before.P[0, 0]), 4.0)
    assert east.state.x is before.x
    assert (north.channel, north.innovation) == ("g.north", -1.0)
    assert north.state.x[0] > 0.0


def played(frames: Sequence[Frame], step_s: float | None, judge: Judge | None) -> list[Estimate]:
    """Of two filters; the board boots again in the middle, so that they start twice."""
    half = len(frames) // 2
    again = [replace(f, boot_id="b2", clock_id="c2", start_no=2, seq=f.seq - half) for f in frames[half:]]
    pipeline = Pipeline(BOAT, ("ukf", "kf"), step_s, judge)
    return [estimate for frame in (*frames[:half], *again) for estimate in pipeline.push(frame).estimates]


@pytest.mark.parametrize("step_s", [None, 1.0])
def test_the_pipeline_hands_its_judge_to_every_filter_at_every_start(
    short_voyage: list[Frame], step_s: float | None
) -> None:
    frames = short_voyage[:80]
    free = played(frames, step_s, None)
    assert {(each.filter, each.boot_id) for each in free} == {
        (name, boot) for name in ("ukf", "kf") for boot in (frames[0].boot_id, "b2")
    }
    assert played(frames, step_s, Always(1.0)) == free
    assert all(each.channels for each in free[-2:])
    assert not any(each.channels for each in played(frames, step_s, Always(None)))


@pytest.mark.parametrize("name", ["fuzzy", "ukf"])
def test_a_scale_acts_on_the_filter_of_a_boat_too(name: str, short_voyage: list[Frame]) -> None:
    """A judge that makes every R a million times as large leaves the place as doubtful as it began."""
    sigmas = []
    for judge in (None, Always(1e6)):
        pipeline = Pipeline(BOAT, (name,), judge=judge)
        estimates = [each for frame in short_voyage[:300] for each in pipeline.push(frame).estimates]
        sigmas.append(estimates[-1].sigma_heading_deg)
    assert sigmas[1] > 2.0 * sigmas[0]
