"""
Max-mixtures of candidate arrivals: laws, picks, persistence and statistics, in uniform water
between two plane mirrors.
"""

import re
from dataclasses import replace
from itertools import product

import factories
import numpy as np
import pytest
from factories import far_from
from refusals import refused
from scipy import stats

from pymantaray.errors import EstimationError
from pymantaray.estimation import (
    LOSSES,
    CandidateArrivals,
    Estimator,
    MeanSlowness,
    Method,
    MixtureOptions,
    RangeEndpoints,
    solve_conditions,
)
from pymantaray.estimation.ranges.candidates import CandidateModel, of_picks
from pymantaray.estimation.ranges.expansion import Expansion
from pymantaray.estimation.ranges.picks import (
    NONE,
    Chains,
    EpochMixture,
    RangeChoice,
    best_picks,
    graduated_fits,
)
from pymantaray.estimation.ranges.range_models import TimedRanges
from pymantaray.records import SolveStatus

SPEED = 1480.0
BOUNCES = ((0, 0), (1, 0), (0, 1), (1, 1), (2, 1))
WEIGHTS = (0.3, 0.3, 0.2, 0.1, 0.1)


class Mirrors(CandidateModel):
    """Uniform water between plane mirrors: paths are straight to the images of the receiver."""

    def __init__(
        self, top, bottom, *, speed=SPEED, weights=WEIGHTS, mixture=None, order=None, sigma=0.0
    ):
        self.top, self.bottom, self.sound_speed, self.weights = top, bottom, speed, weights
        self.mixture, self.order, self.sigma = mixture or MixtureOptions(), order, sigma

    def paths(self, links):
        """Travel time and gradients of each path, (n_paths, n, ...)."""
        height = self.bottom - self.top
        out = []
        for k, (surface, _) in enumerate(BOUNCES):
            image, sign = links.receiver.copy(), 1.0
            if k == 1:
                image[:, 2], sign = 2.0 * self.top - image[:, 2], -1.0
            elif k == 2:
                image[:, 2], sign = 2.0 * self.bottom - image[:, 2], -1.0
            elif k > 2:
                away = -1.0 if surface == 1 else 1.0  # surface, then bed; surface, bed, surface
                image[:, 2] = (
                    image[:, 2] + 2.0 * away * height
                    if k == 3
                    else 2.0 * (self.top - height) - image[:, 2]
                )
                sign = 1.0 if k == 3 else -1.0
            step = image - links.transmitter
            distance = np.linalg.norm(step, axis=1)
            along = step / distance[:, None] / self.sound_speed
            out.append((distance / self.sound_speed, -along, along * [1.0, 1.0, sign]))
        return [np.stack(parts) for parts in zip(*out, strict=True)]

    def candidates(self, links):
        time, by_a, by_b = self.paths(links)
        n = links.time.size
        kind, row = (i.ravel() for i in np.indices((len(BOUNCES), n)))
        some = np.flatnonzero(np.array(self.weights)[kind] > 0.0)
        if self.order is not None:
            some = np.random.default_rng(self.order).permutation(some)
        kind, row = kind[some], row[some]
        bounces = np.array(BOUNCES)[kind].T
        return CandidateArrivals.of(
            row,
            time[kind, row],
            (by_a[kind, row], by_b[kind, row]),
            np.array(self.weights)[kind],
            sigma=self.sigma * time[kind, row] / self.sound_speed,
            bounces=(bounces[0], bounces[1]),
        )

    def predict(self, links):
        found = self.candidates(links)
        return of_picks(found.prediction, np.searchsorted(found.row, np.arange(links.time.size)))


class Alone(CandidateModel):
    """Another range model, as a mixture whose ranges have one candidate."""

    mixture = MixtureOptions(null_weight=0.0, gate=1e6)

    def __init__(self, model):
        self.model = model

    def predict(self, links):
        return self.model.predict(links)

    def candidates(self, links):
        found, none = self.model.predict(links), np.zeros(links.time.size)
        ends = found.transmitter_gradient, found.receiver_gradient
        count = none.astype(int)
        return CandidateArrivals.of(
            np.arange(none.size),
            found.travel_time,
            ends,
            none + 1.0,
            sigma=none,
            bounces=(count, count),
        )


def links_of(o, position):
    position = np.concatenate(
        [position, np.repeat(o.landmark_position[:, None], o.time.size, axis=1)]
    )
    a, b = (position[end, o.range_sample] for end in (o.range_transmitter, o.range_receiver))
    return RangeEndpoints(o.time[o.range_sample], a, b, o.transmitter_sound_speed)


def mirrors_about(fleet, gap=300.0, **options):
    """Mirrors above and below a fleet."""
    z = fleet.position[..., 2]
    return Mirrors(z.min() - gap, z.max() + 1500.0, **options)


def received(fleet, model, seed, *, stay=0.0):
    """
    Measurements whose receivers take a path by its weight, and the path of each; noise is that of
    the straight ranges.
    """
    o, rng = fleet.noisy, np.random.default_rng(seed)
    time, _, _ = model.paths(links_of(fleet.noise_free, fleet.position))
    n = o.range_sample.size
    path = rng.choice(len(BOUNCES), n, p=np.array(model.weights) / sum(model.weights))
    last = {}
    for row in np.argsort(o.range_sample, kind="stable").tolist():
        pair = o.range_transmitter[row], o.range_receiver[row]
        if pair in last and rng.random() < stay:
            path[row] = path[last[pair]]
        last[pair] = row
    noise = o.straight_range - fleet.noise_free.straight_range
    return replace(
        o, refracted_range=o.transmitter_sound_speed * time[path, np.arange(n)] + noise
    ), path


def estimate(o, model, initial=None, **options):
    e = Estimator("refracted", "refracted", model, initial=initial, **options)
    return solve_conditions(o, {"e": e}, covariance_samples=np.array([o.time.size - 1]))["e"]


def straight(o):
    return solve_conditions(
        o, {"e": Estimator("straight")}, covariance_samples=np.array([o.time.size - 1])
    )["e"]


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def at_pings(found, fleet):
    """Error at the pings."""
    samples = np.unique(fleet.noisy.range_sample)
    return rms((found.position - fleet.position)[:, samples])


def nees(found, fleet):
    """Of the last positions of all vehicles, jointly, divided by its dimension."""
    error = (found.position - fleet.position)[:, -1].ravel()
    covariance = found.covariances.position[0].reshape(error.size, error.size)
    return float(error @ np.linalg.solve(covariance, error)) / error.size


def test_mixture_of_one_candidate_is_the_plain_factor(make_fleet):
    fleet = make_fleet(seed=2, n_vehicles=2, n_times=16, gnss_every=10, n_landmarks=2)
    water = MeanSlowness([0.0, 2000.0, 6000.0], [1450.0, 1470.0, 1500.0])
    plain = estimate(fleet.noisy, water, model_is_right=True)
    alone = estimate(fleet.noisy, Alone(water), model_is_right=True)
    assert alone.status == plain.status
    assert alone.final_cost == pytest.approx(plain.final_cost, rel=1e-12)
    assert np.abs(alone.position - plain.position).max() < 1e-5
    np.testing.assert_allclose(
        alone.covariances.position, plain.covariances.position, rtol=1e-6, atol=1e-12
    )


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 4])
def test_mixture_is_as_good_as_ranges_without_mistakes(make_fleet, seed):
    fleet = make_fleet(seed=seed, n_vehicles=5, n_times=21)
    model = mirrors_about(fleet)
    o, path = received(fleet, model, seed)
    assert np.count_nonzero(path) > path.size / 2  # most are mistaken
    found, clean = estimate(o, model), straight(o)
    assert found.status == SolveStatus.OK
    errors = rms(found.position - fleet.position), rms(clean.position - fleet.position)
    assert errors[0] < 1.5 * errors[1], errors
    confused = estimate(
        o,
        Mirrors(
            model.top, model.bottom, weights=(1.0, 0.0, 0.0, 0.0, 0.0), mixture=MixtureOptions(0.0)
        ),
    )
    assert not confused.usable or rms(confused.position - fleet.position) > 10.0 * errors[1]


@pytest.fixture(scope="module")
def pair():
    """Two vehicles, what they measure, and the estimate from the start of dead reckoning."""
    fleet = factories.make_fleet(seed=3, n_vehicles=2, n_times=16)
    o, _ = received(fleet, mirrors_about(fleet), 3)
    return fleet, o, estimate(o, mirrors_about(fleet))


def test_start_does_not_matter(pair):
    fleet, o, found = pair
    other = estimate(o, mirrors_about(fleet), far_from(fleet))
    assert np.abs(found.position - other.position).max() < 1e-4


def test_order_of_candidates_changes_nothing(pair):
    fleet, o, found = pair
    other = estimate(o, mirrors_about(fleet, order=1))
    np.testing.assert_array_equal(found.position, other.position)
    np.testing.assert_array_equal(found.covariances.position, other.covariances.position)


def test_range_of_no_candidate_is_gated(make_fleet):
    fleet = make_fleet(seed=6, n_vehicles=2, n_times=11)
    model = mirrors_about(fleet)
    o, _ = received(fleet, model, 6)
    odd = np.arange(0, o.range_sample.size, 9)
    longer = o.refracted_range.copy()
    longer[odd] += 137.0
    found = estimate(replace(o, refracted_range=longer), model)
    assert found.status == SolveStatus.OK
    assert found.gated_links == odd.size
    kept = np.setdiff1d(np.arange(o.range_sample.size), odd)
    without = replace(
        o,
        **{
            name: getattr(o, name)[kept]
            for name in vars(o)
            if name.startswith("range_")
            or name in {"refracted_range", "straight_range", "transmitter_sound_speed"}
        },
    )
    assert np.abs(found.position - estimate(without, model).position).max() < 1e-3


def test_unknown_scale_of_travel_times_is_estimated_with_the_picks(make_fleet):
    fleet = make_fleet(seed=8, n_vehicles=3, n_times=21)
    model = mirrors_about(fleet)
    o, _ = received(fleet, model, 8)
    slower = mirrors_about(fleet, speed=SPEED - 3.0)
    found = estimate(o, slower, scale_sigma=5e-3)
    assert found.unknowns.name == ("scale",)
    (scale,) = found.unknowns.value
    assert scale == pytest.approx(
        (SPEED - 3.0) / SPEED - 1.0, abs=4.0 * np.sqrt(found.unknowns.covariance[0, 0])
    )
    assert rms(found.position - fleet.position) < 1.5 * rms(straight(o).position - fleet.position)


def test_picks_of_a_pair_are_the_most_probable_sequence_of_all():
    rng = np.random.default_rng(11)
    times = np.array([0.0, 300.0, 900.0, 1000.0])
    zero = np.zeros(4, dtype=int)
    ranges = TimedRanges(zero, zero + 1, np.arange(4), times, np.ones(4), np.ones(4))
    chains = Chains.of(ranges, np.array([0, 1]), 500.0)
    np.testing.assert_allclose(chains.stay[1:], np.exp(-np.diff(times) / 500.0))
    for _ in range(20):
        every, first = [], 0
        for size in rng.integers(1, 4, 4):
            prior = rng.dirichlet(np.ones(size + 1))
            family = np.append(rng.permutation(4)[:size], NONE)
            rows = np.append(np.arange(first, first + size), NONE)
            every.append(RangeChoice(rows, rng.uniform(0.0, 3.0, size + 1), prior, family))
            first += size

        def cost(numbers, every=every):
            total = 0.0
            for k, (choice, number) in enumerate(zip(every, numbers, strict=True)):
                p = choice.prior[number]
                if k:
                    before = every[k - 1].family[numbers[k - 1]]
                    if before in choice.family:
                        stay = chains.stay[k]
                        p = stay * (choice.family[number] == before) + (1.0 - stay) * p
                total += choice.fit[number] - np.log(p)
            return total

        best = min(product(*(range(c.fit.size) for c in every)), key=cost)
        expected = [c.candidate[number] for c, number in zip(every, best, strict=True)]
        np.testing.assert_array_equal(best_picks(every, chains), expected)


class Echoed(Mirrors):
    """
    Water in which the second path is the first one, 3 m later: three standard deviations of a
    range.
    """

    def paths(self, links):
        time, by_a, by_b = super().paths(links)
        time[1], by_a[1], by_b[1] = time[0] + 3.0 / self.sound_speed, by_a[0], by_b[0]
        return time, by_a, by_b


@pytest.mark.slow
def test_wrong_weights_are_worse(make_fleet):
    errors = []
    for seed in range(4):
        fleet = make_fleet(seed=seed, n_vehicles=3)
        right, wrong = (Echoed(0.0, 9e3, weights=(w, 1.0 - w, 0.0, 0.0, 0.0)) for w in (0.9, 1e-4))
        o, _ = received(fleet, right, seed)
        errors.append([rms(estimate(o, m).position - fleet.position) for m in (right, wrong)])
    right, wrong = np.sqrt(np.mean(np.square(errors), axis=0))
    assert wrong > 1.05 * right, (right, wrong)


@pytest.mark.slow
def test_persistence_helps_if_receivers_stay_with_their_arrivals(make_fleet):
    errors = []
    for seed in range(4):
        fleet = make_fleet(seed=seed, n_landmarks=3)
        weights = (0.5, 0.5, 0.0, 0.0, 0.0)
        alone, chained = (
            Echoed(0.0, 9e3, weights=weights, mixture=MixtureOptions(persistence=p))
            for p in (0.0, 1e5)
        )
        o, _ = received(fleet, alone, seed, stay=0.99)
        errors.append([at_pings(estimate(o, m), fleet) for m in (alone, chained)])
    alone, chained = np.sqrt(np.mean(np.square(errors), axis=0))
    assert chained < 0.9 * alone, (chained, alone)


@pytest.mark.slow
def test_errors_have_the_covariance_that_the_mixture_gives(make_fleet):
    values, ratios, seeds = [], [], 10
    for seed in range(seeds):
        fleet = make_fleet(seed=seed, n_vehicles=4)
        model = mirrors_about(fleet)
        o, _ = received(fleet, model, seed)
        found, clean = estimate(o, model), straight(o)
        assert found.status == SolveStatus.OK, seed
        values.append(nees(found, fleet))
        ratios.append([rms(f.position - fleet.position) for f in (found, clean)])
    dimension = 12 * seeds
    low, high = stats.chi2.ppf([0.001, 0.999], dimension) / dimension
    mixture, best = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert mixture < 1.5 * best, (mixture, best)
    assert low < np.mean(values) < high, (np.mean(values), low, high)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"null_weight": 1.0}, "mixture: null_weight is 1; it must be at least 0 and less than 1"),
        ({"null_width": 0.0}, "mixture: null_width is 0; it must be positive and finite [m]"),
        (
            {"persistence": -1.0},
            "mixture: persistence is -1; it must be zero or positive and finite [s]",
        ),
        (
            {"gate": np.inf},
            "mixture: gate is inf; it must be positive and finite, in standard deviations",
        ),
    ],
)
def test_impossible_mixture_is_refused(options, message):
    refused(EstimationError, re.escape(message), MixtureOptions, **options)


def test_mixture_with_a_loss_is_refused(make_fleet):
    fleet = make_fleet(seed=1)
    model = mirrors_about(fleet)
    refused(
        EstimationError,
        "has no robust loss",
        estimate,
        fleet.noisy,
        model,
        method=Method(LOSSES["huber"]),
    )


def ping_of_a_vehicle(seed, spread=30.0, sigma=0.5):
    """
    Candidates of ranges to four landmarks from a vehicle near the surface, and the images of the
    landmarks.
    """
    rng = np.random.default_rng(seed)
    landmark = np.array(
        [[1500.0, 300, 200], [-800, 1200, 90], [400, -1800, 250], [-1300, -700, 150]]
    )
    place, water = np.array([0.0, 0.0, 20.0]), Mirrors(0.0, 300.0)
    root = np.array([spread, spread, 0.1])
    true = place + root * rng.standard_normal(3)
    taken = rng.choice(len(BOUNCES), 4, p=WEIGHTS)
    links = RangeEndpoints(np.zeros(4), np.tile(place, (4, 1)), landmark, np.full(4, SPEED))
    table = water.candidates(links)
    time = water.paths(links._replace(transmitter=np.tile(true, (4, 1))))[0][taken, np.arange(4)]
    measured = time + sigma / SPEED * rng.standard_normal(4)
    each = RangeEndpoints(*(column[table.row] for column in links))
    expansion = Expansion(
        table.prediction, each, measured[table.row], np.empty(0), np.empty((table.row.size, 0))
    )
    variance, covariance = np.full(table.row.size, sigma**2), 1e-8 * np.eye(15)
    covariance[:3, :3] = np.diag(root**2)
    mixture = EpochMixture(
        expansion=expansion,
        transmitter=np.zeros(table.row.size, dtype=int),
        receiver=1 + table.row,
        position=np.concatenate([place[None], landmark]),
        unknowns=np.empty(0),
        covariance=covariance,
        row=table.row,
        variance=variance,
        smallest=variance,
        weight=table.weight,
        null=np.full(4, 1e-9),
    )
    return mixture, root, SPEED * measured, sigma


def cost_of_picks(mixture, root, distance, sigma, picks):
    """
    Least cost of a position for each set of picks (n, 4), by Newton's method on distances to
    images.
    """
    table = mixture.expansion
    at, image = mixture.position[0], table._receiver[picks]
    moved = np.zeros((len(picks), 3))
    for _ in range(6):
        step = at + moved[:, None] - image
        far = np.linalg.norm(step, axis=2)
        slope = step / far[..., None] / sigma
        residual = (far - distance) / sigma
        matrix = np.eye(3) / root**2 + np.einsum("nki,nkj->nij", slope, slope)
        right = np.einsum("nki,nk->ni", slope, residual) + moved / root**2
        moved = moved - np.linalg.solve(matrix, right[..., None])[..., 0]
    far = np.linalg.norm(at + moved[:, None] - image, axis=2)
    prior = np.sum((moved / root) ** 2, axis=1)
    return 0.5 * (prior + np.sum(((far - distance) / sigma) ** 2, axis=1)) - np.log(
        mixture.weight[picks]
    ).sum(axis=1)


def test_the_picks_of_a_ping_are_those_of_an_enumeration():
    every = np.array(list(product(range(5), repeat=4))) + 5 * np.arange(4)
    excess = []
    for seed in range(5):
        mixture, *measured = ping_of_a_vehicle(seed)
        least = cost_of_picks(mixture, *measured, every).min()
        cost = graduated_fits(mixture, 5.0) - np.log(mixture.weight)
        picks = cost.reshape(4, 5).argmin(axis=1) + 5 * np.arange(4)
        excess.append(cost_of_picks(mixture, *measured, picks[None])[0] - least)
    assert max(excess) < 1e-6, excess
