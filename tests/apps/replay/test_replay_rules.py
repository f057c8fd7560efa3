"""The arrival that each rule takes, its next candidate, and picks that a limit decides."""

from dataclasses import replace

import numpy as np
import pytest
from factories import make_arrivals

from pymantaray.acoustics import Sonar
from pymantaray.apps.replay.rules import Choice, DetectionRule
from pymantaray.sensing.receptions import AlongRays, SoundPath, receptions_of

LOSS = np.array([76.0, 71.5, 66.0, 70.0, 90.0])  # of five arrivals in order of time
TIME = 1.0 + 1e-3 * np.arange(5)
SPREADING = LOSS - 66.0


def choice(cutoff=15.0, merit=200.0):
    sonar = Sonar(source_level_db=merit + 90.0, frequency_hz=25e3, bandwidth_hz=1e3, noise=50.0)
    assert sonar.figure_of_merit_db == pytest.approx(merit)
    arrivals = make_arrivals(np.zeros(5), travel_time=TIME, spreading_db=SPREADING)
    forth = receptions_of(arrivals, AlongRays(None, LOSS)).at({"reception": np.arange(5)})
    return Choice(forth, 1, LOSS, cutoff, sonar)


CASES = {  # pick, and the next
    "first": (0, 1),
    "strongest": (2, 3),
    "within:6": (1, 2),
    "within:10": (0, 1),
    "within:0": (2, -1),
    "threshold": (1, 2),
}


@pytest.mark.parametrize("word", CASES)
def test_each_rule_takes_its_arrival_and_then_the_next(word):
    rule, link = DetectionRule.parse(word), choice(merit=75.0)
    candidates = link.candidates(rule)
    picks = link.pick(rule, candidates)
    assert (picks[0], link.next(rule, candidates, picks)[0]) == CASES[word]
    assert not candidates[4]  # beyond the cut-off


NEAR = {  # rule, cut-off, figure of merit: whether 1 dB decides
    ("first", 15.0, 200.0): False,
    ("first", 10.4, 200.0): True,  # the first arrival, at 10 dB, would be lost
    ("first", 9.5, 200.0): True,  # the first arrival would come in
    ("first", 23.5, 200.0): False,  # the last one would, but it is not the first
    ("strongest", 10.4, 200.0): False,
    ("within:6", 15.0, 200.0): True,  # the second, at 5.5 dB, would be lost
    ("within:8", 15.0, 200.0): False,
    ("within:9.2", 15.0, 200.0): True,  # the first would come in
    ("threshold", 15.0, 75.2): True,
    ("threshold", 15.0, 74.0): False,
}


@pytest.mark.parametrize("case", NEAR)
def test_a_pick_that_one_decibel_would_change_is_marked(case):
    word, cutoff, merit = case
    rule, link = DetectionRule.parse(word), choice(cutoff, merit)
    picks = link.pick(rule, link.candidates(rule))
    assert link.near_limit(rule, picks)[0] == NEAR[case]


@pytest.mark.parametrize("word", CASES)
def test_sound_without_a_ray_passes_every_limit(word):
    rule, one = DetectionRule.parse(word), choice(cutoff=0.0, merit=50.0)
    row = one.receptions.at({"reception": [4]})
    leak = replace(row, path=[SoundPath.LEAKED], arrival=[-1])
    alone = one._replace(receptions=leak, loss_db=LOSS[4:])
    picks = alone.pick(rule, alone.candidates(rule))
    assert picks.tolist() == [0]
    assert not alone.within_cutoff().any()
    assert not alone.near_limit(rule, picks).any()


def test_nothing_above_the_threshold_is_no_pick():
    rule, deaf = DetectionRule.parse("threshold"), choice(merit=50.0)
    assert deaf.pick(rule, deaf.candidates(rule))[0] == -1
