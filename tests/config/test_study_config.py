"""
Configuration: the paper's tables, strictness at every level, and one clear line for each fault.
"""

import itertools
import math
import re
import tomllib
from typing import Literal, get_origin

import pytest
import tomli_w
from factories import TINY
from refusals import refused

from pymantaray.config import (
    checks,
    list_presets,
    load_sound,
    load_study,
    parse_study,
    preset_text,
    study_toml,
)
from pymantaray.config.door.fleet import build_pings, build_vehicles
from pymantaray.config.door.study import build_study
from pymantaray.config.fleet import FloatSection, FloatVehicle, StationVehicle
from pymantaray.config.mission import MissionSection, keys_of_schedule
from pymantaray.config.sections import StudyConfig
from pymantaray.errors import StudyError
from pymantaray.fleet import FloatCycle
from pymantaray.sensing import PingSchedule

PAPER_TARGETS = {
    "G": 250, "B": 500, "D": 750, "I": 1000, "K": 1250, "F": 1500, "J": 1750, "C": 2000, "E": 2250,
    "H": 2500,
}  # fmt: skip


@pytest.fixture
def quick():
    return tomllib.loads(preset_text("quick"))


@pytest.mark.parametrize("name", ["beaufort", "fram"])
def test_presets_hold_the_papers_tables(name):
    config = load_study(name)
    mission, noise, floats = config.mission, config.noise, config.fleet.floats
    assert (mission.duration_h, mission.physics_step_s) == (168, 0.125)
    assert (mission.sampling_period_s, mission.ping_interval_h) == (200, 4)
    assert (floats.hold_depth_h, floats.hold_surface_h, floats.vertical_speed) == (24, 1, 0.5)
    assert config.study.realizations == 25
    assert config.detection is None
    assert (config.ranging.timing, config.ranging.mistaken) == ("one-way", "none")
    assert (config.noise.clock_offset_sigma, config.noise.clock_skew_sigma) == (0.0, 0.0)
    assert config.acoustics.arrival == "direct"
    assert (config.acoustics.max_surface_bounces, config.acoustics.max_bottom_bounces) == (0, 0)
    assert (config.ocean.time_varying, config.ocean.equation) == (False, "teos-10")
    assert (noise.range_sigma, noise.depth_sigma, noise.gnss_sigma) == (1.0, 0.01, 0.10)
    assert (noise.odometry_rotation_fraction, noise.odometry_rotation_drift) == (1e-6, 5e-7)
    assert (noise.odometry_xy_fraction, noise.odometry_z_fraction) == (0.05, 0.001)
    assert noise.odometry_translation_drift == 0.0125
    targets = {v.name: v.target_depth for v in config.fleet.vehicles if isinstance(v, FloatVehicle)}
    assert targets == PAPER_TARGETS
    assert [v.name for v in config.fleet.vehicles if isinstance(v, StationVehicle)] == ["A"]


def test_paper_presets_differ_in_nothing_but_the_region():
    beaufort, fram = load_study("beaufort"), load_study("fram")
    same = {"study": beaufort.study, "ocean": beaufort.ocean}
    assert fram.model_copy(update=same) == beaufort
    assert (beaufort.ocean.centre, fram.ocean.centre) == ((74.5, -140.0), (78.0, 0.0))


def test_grid_spans_2_to_12_km_around_the_station_keeper():
    places = {v.name: (v.north, v.east) for v in load_study("beaufort").fleet.vehicles}
    distances = [math.dist(a, b) for a, b in itertools.combinations(places.values(), 2)]
    assert len(distances) == 55
    assert min(distances) == 2000
    assert max(distances) == 12000
    for axis in (0, 1):
        assert math.fsum(place[axis] for place in places.values()) == places["A"][axis] == 0


def test_defaults_are_the_presets_values():
    """
    What a file leaves out is what the paper has, so a bare file is a study of the paper's kind.
    """
    full = load_study("beaufort")
    tree = tomllib.loads(preset_text("beaufort"))
    for section in ("mission", "noise", "acoustics", "estimator", "conditions"):
        del tree[section]
    del tree["fleet"]["floats"]
    for key in ("seed", "realizations"):
        del tree["study"][key]
    assert parse_study(tree) == full


PERTURBED = {"kind": "perturbed", "rms": 1.0, "horizontal_scale": 2e4, "down_to": 300.0}
LONG = {
    "range_model": {"kind": "eigenray", "belief": PERTURBED},
    "variance": "correlated",
    "start": "dead-reckoning",
}
SHORT = {"range_model": {"kind": "constant", "sound_speed": 1450.0}, "loss": "huber"}


@pytest.mark.parametrize("sections", [
    *list_presets(),
    {"detection": {"source_level_db": 160.0, "frequency_hz": 25e3, "bandwidth_hz": 4e3}},
    {"ranging": {"timing": "two-way", "turn_around_s": 0.5}, "noise": {"clock_skew_sigma": 1e-6}},
    {"ranging": {"mistaken": "first-detected", "below_strongest_db": 9.0}},
    {"conditions": ["odometry", {"name": "a"} | SHORT, {"name": "b"} | LONG]},
    {"conditions": []},
], ids=str)  # fmt: skip
def test_resolved_configuration_reads_back_equal(tiny, sections, tmp_path):
    config = load_study(sections) if isinstance(sections, str) else tiny(**sections)
    (tmp_path / "config.toml").write_text(study_toml(config))
    assert load_study(tmp_path / "config.toml") == config
    if isinstance(sections, dict) and len(config.conditions) == 3:
        assert config.conditions[2].uncertainty == (1.0, 2e4, 300.0)


EXACT = {"kind": "exact"}
DETECTION = {"source_level_db": 160.0, "frequency_hz": 25e3, "bandwidth_hz": 4e3}
EIGENRAY = {"range_model": {"kind": "eigenray", "belief": EXACT}}
UNSURE = {"kind": "per-link", "rms": 1.0, "horizontal_scale": 1e4}
LAG = {"kind": "fixed-lag", "lag_h": 8.0}

BOUNCE = {"max_surface_bounces": 1}
ICE = {"detection": DETECTION, "acoustics": {"ice_loss_db": 3.0}}
ICE_BOUNCE = {"detection": DETECTION, "acoustics": {"ice_loss_db": 3.0} | BOUNCE}
DEEP = {"mistaken": "first-detected", "below_strongest_db": 6.0}

DURATION = 'allowed: a number of hours, or text such as "10 min" (units us, µs, ms, s, min, h, d)'

REFUSED = [
    ("mission.duration_h", "7", f"mission.duration_h: found '7'; {DURATION}"),
    ("mission.duration_h", "7 days", f"mission.duration_h: found '7 days'; {DURATION}"),
    ("mission.duration_h", "-1 h", "mission.duration_h: found -1.0; allowed: greater than 0"),
    ("mission.duration_h", "0 min", "mission.duration_h: found 0.0; allowed: greater than 0"),
    ("ranging.turn_around_s", "",
     "ranging.turn_around_s: found ''; allowed: a number of seconds, or text"),
    ("mission.duration_h", "9" * 400 + " d", "mission.duration_h: found inf; allowed"),
    ("study.realizations", 0, "study.realizations: found 0; allowed: 1 or more"),
    ("study.realizations", 2.5, "study.realizations: found 2.5"),
    ("noise.range_sigma", "1 s", "noise.range_sigma: found '1 s'; allowed: a number"),
    ("conditions", ["curved", "curved"],
     "names of conditions must differ; found curved more than once"),
    ("conditions", "straight", "conditions: found 'straight'; allowed: a list"),

    ("conditions", [{"name": "truth", "ranges": "straight"}],
     "conditions: 'truth' is the name of the true poses; rename it"),
    ("study.name", "a/b", ("study.name: found 'a/b'; allowed: 1 to 128 letters, digits and ._-,"
                          " the first a letter or digit")),
    ("study.name", "x" * 129, "allowed: 1 to 128 letters"),
    ("fleet.vehicles.1.target_dept", 3.0, ("`fleet.vehicles[1].target_dept`: unknown key. Did you"
                                          " mean `fleet.vehicles[1].target_depth`?")),
    ("fleet.vehicles.1.kind", "boat", "fleet.vehicles[1].kind: found 'boat'; allowed: 'float', "),
    ("fleet.vehicles.1.name", "", "vehicles[1].name: found ''"),
    ("fleet.vehicles.1.name", "../up", "found '../up'; allowed: 1 to 64 letters, digits, _ and -"),
    ("fleet.vehicles.1.name", "x" * 65, "allowed: 1 to 64 letters"),
    ("fleet.vehicles.1.name", "A", "vehicle names must differ; found A more than once"),
    ("fleet.vehicles.1.name", "L0", "names of vehicles and landmarks must differ; found L0"),
    ("mission.ping_interval_h", 0.1, "ping_interval_h is 360 s; it must be a whole multiple of"),
    ("mission.physics_step_s", 0.3, "sampling_period_s is 200 s; it must be a whole multiple of"),
    ("mission.duration_h", 0.5, "duration_h is 1800 s; it must not be less than ping_interval_h"),
    ("noise.range_sigma", 0.0, "noise.range_sigma: found 0.0; allowed: greater than 0"),
    ("noise.range_sigma", math.inf, "noise.range_sigma: found inf"),
    ("noise.range_sigma", "1", "noise.range_sigma: found '1'"),
    ("ocean.source", ["a\0.nc"],
     r"ocean.source[0]: found 'a\x00.nc', which is not a valid file name"),
    ("ocean.source", ["synthetic:fram", "a.nc"],
     "a synthetic ocean cannot be combined with others"),
    ("ocean.centre_lat", None, "centre_lat and centre_lon must be given together"),
    ("ocean.ice", -1.0, "ocean.ice: found -1.0; allowed: 0 or more or text"),
    ("acoustics.spreading_cutoff_db", -1.0, "found -1.0; allowed: greater than 0 or 'none'"),
    ("ocean.half_extent_north", None,
     "half_extent_north and half_extent_east must be given together"),
    ("ranging.turn_around_s", 2.0, "ranging: turn_around_s is 2 s, but timing is one-way"),
    ("ranging.below_strongest_db", 6.0, "ranging: below_strongest_db is 6, but mistaken is none"),
    ("ranging.mistaken_correlation_s", 60.0,
     "ranging: mistaken_correlation_s is 60 s, but mistaken is none"),
    ("ranging", DEEP | {"mistaken": "strongest-detected"}, "but mistaken is strongest-detected"),
    ("ranging.mistaken", "first-detected", "is first-detected, but there is no rule of detection"),
    ("", {"ranging": DEEP, "detection": DETECTION},
     "below_strongest_db and [detection] cannot be combined"),
    ("", {"ranging": DEEP, "acoustics": {"arrival": "first"}}, "but acoustics.arrival is first"),
    ("detection", DETECTION | {"scatter_db": 40.0}, "scatter_db is 40, but leakage is false"),
    ("acoustics.max_bottom_bounces", 16,
     "acoustics.max_bottom_bounces: found 16; allowed: 15 or less"),
    ("detection", {"frequency_hz": 1e4, "bandwidth_hz": 1e3}, ("detection.source_level_db: missing;"
                                                              " add it (level of a ping at 1 m, in"
                                                              " the band [dB re 1 µPa])")),
    ("mission.schedule", {"slot_s": 5.0},
     "mission.schedule.kind: missing; add it, one of 'slots', 'pings'"),
    ("mission.schedule", "slots", "mission.schedule: found 'slots'; allowed: a table"),
    ("ocean.time", "noon", "ocean.time: found 'noon'; allowed: a time as 2014-07-15T12:00:00"),
    ("ocean", 5, "ocean: found 5; allowed: a table"),
    ("ocean.source", "", "ocean.source[0]: found ''; allowed: text of at least one letter"),
    ("detection", DETECTION | {"bandwidth_hz": 6e4},
     "detection: bandwidth_hz is 60000, but frequency_hz"),
    ("detection", DETECTION | {"shipping": 0.5, "noise_spectral_level_db": 40.0},
     "cannot be combined"),
    ("acoustics", {"surface_loss": "bubbles"},
     "is bubbles, but acoustics.max_surface_bounces is 0"),
    ("acoustics", {"sediment": "sand"}, "is sand, but acoustics.max_bottom_bounces is 0"),
    ("acoustics", BOUNCE | {"surface_loss": "bubbles"},
     "is bubbles, but without [detection] every arrival is detected"),
    ("ocean", {"internal_tide": {"amplitude": 5.0}, "time_varying": True},
     "internal_tide needs a single snapshot"),
    ("ocean.internal_tide", {"amplitude": -5.0}, "ocean.internal_tide.amplitude: found -5"),
    ("", ICE_BOUNCE, "there is no ice"),
    ("", ICE | {"ocean": {"ice": 2.0}}, "max_surface_bounces is 0"),
    (
        "",
        ICE_BOUNCE
        | {"ocean": {"ice": 2.0},
           "acoustics": ICE_BOUNCE["acoustics"] | {"surface_loss": "bubbles"}},
        "cannot be combined",
    ),
    *((f"{s}.surprise", 1, (f"`{s}.surprise`: unknown key. Allowed:"
                           " ")) for s in ("study", "ocean", "ranging", "noise", "fleet")),
]  # fmt: skip
VARYING = EXACT | {"time_varying": True}
CAST = {"kind": "cast", "north": 1.0}


def rays(belief, **options):
    return {"range_model": {"kind": "eigenray", "belief": belief, **options}}


REFUSED_CONDITIONS = [
    ({"name": "two words"}, "conditions[0].name: found 'two words'"),
    (
        {"name": "straight", "loss": "huber"},
        "loss is given, but `straight` is a standard condition",
    ),
    (
        {"name": "straight", "ranges": "refracted"},
        "ranges is given, but `straight` is a standard condition",
    ),
    (
        {"name": "odometry", "solver": LAG},
        "solver is given, but `odometry` is a standard condition",
    ),
    ({"range_model": "constant"}, "range model constant needs sound_speed"),
    (
        {"range_model": "eigenray"},
        "conditions[0].range_model.belief: missing; add it (the assumed ocean",
    ),
    ({"belief": EXACT}, "`conditions[0].belief`: unknown key. "),
    (
        {"range_model": {"kind": "transmitter", "belief": "exact"}},
        "range_model.belief`: unknown key.",
    ),
    (
        {"range_model": "curved"},
        "conditions[0].range_model.kind: found 'curved'; allowed: 'transmitter', ",
    ),
    (
        {"ranges": "none", "loss": "huber"},
        'loss is given, but ranges is "none"; remove one of the two',
    ),
    ({"ranges": "none", "range_sigma": 3.0}, 'range_sigma is given, but ranges is "none"'),
    (
        {"solver": "dead-reckoning"},
        'solver "dead-reckoning" uses no ranges, but ranges is refracted',
    ),
    ({"links": "all"}, "a dropout has none"),
    ({"ranges": "straight"} | SHORT, "ranges is straight, which needs no travel times"),
    ({"variance": "per-link"}, "computed along eigenrays"),
    (EIGENRAY | {"variance": "per-link"}, "needs rms and horizontal_scale"),
    ({"variance": {"kind": "fixed", "rms": 1.0}}, "`conditions[0].variance.rms`: unknown key"),
    (EIGENRAY | {"variance": {"kind": "per-link", "rms": 1.0}}, "must be given together"),
    ({"variance": "certain"}, "conditions[0].variance.kind: found 'certain'; allowed: 'fixed', "),
    ({"range_model": {"kind": "mean-slowness", "belief": CAST}}, "must be given together"),
    (rays({"kind": "perturbed", "horizontal_scale": 1e4}), "range_model.belief.rms: missing"),
    (rays({"kind": "exact", "rms": 1.0}), "`conditions[0].range_model.belief.rms`: unknown key"),
    ({"loss": "gnc", "solver": "incremental"}, "gnc"),
    ({"loss": "tukey", "solver": "incremental"}, "tukey"),
    ({"loss": "welsch", "solver": "incremental"}, "welsch"),
    (EIGENRAY | {"solver": "incremental"}, "incremental"),
    (
        EIGENRAY | {"loss": "huber", "variance": UNSURE | {"kind": "correlated"}},
        "loss huber applies to single ranges",
    ),
    (rays("mean", modes={"count": 0}), "range_model.modes.count: found 0; allowed: 1 or more"),
    (rays("mean", modes={"count": 2, "down_to": 300.0}), "down_to is given without rms"),
    (
        {"range_model": {"kind": "mean-slowness", "belief": "mean", "modes": {}}},
        "range_model.modes`: unknown key",
    ),
    (rays("mean", modes={"count": 2}) | {"variance": UNSURE}, "would count twice"),
    ({"clocks": {}, "solver": "incremental"}, "does not estimate"),
    ({"scale_sigma": 0.1, "solver": LAG}, "does not estimate"),
    (
        {"solver": "fixed-lag"},
        (
            "conditions[0].solver.lag_h: missing; add it (lag: time after which poses are"
            " marginalized [h])"
        ),
    ),
    ({"solver": {"kind": "batch", "lag_h": 8.0}}, "`conditions[0].solver.lag_h`: unknown key"),
    ({"solver": LAG, "loss": "huber"}, "no robust loss"),
    ({"directions": "mean", "ranges": "straight"}, 'directions "mean" is for refracted'),
    (EIGENRAY | {"directions": "mean"}, 'directions "mean" is for refracted'),
    (
        {"range_sigma": "fitted", "loss": "huber"},
        'range_sigma "fitted" needs a cost with an expected value',
    ),
    (
        {"range_sigma": "fitted", "solver": LAG},
        'range_sigma "fitted" needs a cost with an expected value',
    ),
    ({"solver": "kalman-filter", "loss": "huber"}, 'solver "kalman-filter" has no robust loss'),
    ({"solver": "kalman-filter", "scale_sigma": 0.1}, "does not estimate"),
    (EIGENRAY | {"solver": "kalman-filter", "variance": UNSURE}, 'has no variance "per-link"'),
    (
        {"range_model": {"kind": "constant", "sound_speed": 1450.0, "belief": {"kind": "mean"}}},
        "needs sound_speed or belief, not both",
    ),
    (
        rays({"kind": "offset", "depth": [9.0, 3.0], "sound_speed": [0.5, 1.0]}),
        "with increasing depths",
    ),
    (
        rays({"kind": "offset", "depth": [9.0], "sound_speed": [0.5, 1.0]}),
        "sound_speed 2; both must have the same number",
    ),
    ({"clocks": {}}, "condition e estimates clocks, but their priors are 0"),
    (rays(VARYING), "condition e assumes an ocean that varies, but the study's does not"),
    (rays(VARYING) | {"variance": UNSURE}, 'for range_model "eigenray" with variance "fixed"'),
    ({"range_model": {"kind": "mean-slowness", "belief": VARYING}}, 'for range_model "eigenray"'),
    (
        rays(VARYING, modes={"count": 1}),
        "modes cannot be estimated for a belief that varies in time",
    ),
]
REFUSED += [
    ("conditions", [{"name": "e", **values}], expected) for values, expected in REFUSED_CONDITIONS
]


@pytest.mark.parametrize(("path", "value", "expected"), REFUSED)
def test_each_invalid_value_is_one_line_with_place_and_allowed_values(tiny, path, value, expected):
    for key in reversed(path.split(".") if path else []):
        value = {key: value}
    with pytest.raises(StudyError) as caught:
        tiny(**value)
    line = str(caught.value)
    assert "\n" not in line
    assert line.startswith("tiny: ")
    assert expected in line


@pytest.mark.parametrize(("path", "text", "number"), [
    ("mission.duration_h", "7 d", 168.0),
    ("mission.duration_h", "1 d 12 h", 36.0),
    ("mission.ping_interval_h", "10 min", 1 / 6),
    ("mission.ping_interval_h", " 1h30min ", 1.5),
    ("mission.physics_step_s", "0.125 s", 0.125),
    ("mission.sampling_period_s", "10 min", 600.0),
    ("fleet.floats.hold_depth_h", "90 min", 1.5),
    ("estimator.covariance_interval_h", ".5 d", 12.0),
])  # fmt: skip
def test_a_duration_with_a_unit_is_the_number_that_its_key_means(tiny, path, text, number):
    section, _, key = path.rpartition(".")
    short = {
        "mission": {
            "duration_h": 600.0,
            "sampling_period_s": 120.0,
            "physics_step_s": 1.0,
            "ping_interval_h": 5.0,
        }
    }

    def with_value(value):
        tree = value = {key: value}
        for name in reversed(section.split(".")):
            tree = {name: tree}
        return tiny(**{name: short.get(name, {}) | tree[name] for name in tree})

    config = with_value(text)
    assert config == with_value(number)
    assert study_toml(config) == study_toml(with_value(number))


def required_keys(model):
    """Models of a configuration with the keys that each must have, by their names."""
    models = {model}
    while (
        inner := {
            m
            for one in models
            for f in one.model_fields.values()
            for m in checks.models_in(f.annotation)
        }
        - models
    ):
        models |= inner
    return [
        (m, name) for m in models for name, field in m.model_fields.items() if field.is_required()
    ]


def test_what_every_required_key_means_is_said_where_it_is_missing():
    required = required_keys(StudyConfig)
    assert len(required) > 30
    for model, name in required:
        if (
            get_origin(model.model_fields[name].annotation) is Literal
        ):  # kind, which says what may stand there
            continue
        with pytest.raises(StudyError) as caught:
            checks.checked(model, {}, "it", None)
        line = next(
            line for line in str(caught.value).splitlines() if line.startswith(f"it: {name}:")
        )
        assert re.fullmatch(rf"it: {name}: missing; add it \([^`]+\)", line), (model, line)


def test_a_table_in_place_of_several_is_refused_with_the_right_syntax(quick):
    quick["landmarks"] = {"name": "L", "north": 0.0, "east": 0.0, "depth": 1.0}
    refused(
        StudyError,
        r"landmarks: found \{.*; allowed: tables in a list, each under \[\[landmarks\]\]",
        parse_study,
        quick,
    )


def test_several_faults_are_several_lines(quick):
    quick["study"]["realizations"] = 0
    del quick["ocean"]["source"]
    with pytest.raises(StudyError) as caught:
        parse_study(quick, "my.toml")
    source, count = str(caught.value).splitlines()
    assert source.startswith(
        "my.toml: ocean.source: missing; add it (files that belong together, a profile or cast,"
        ' "synthetic:beaufort"'
    )
    assert count == "my.toml: study.realizations: found 0; allowed: 1 or more"


def test_sections_of_ranging_are_read_from_a_study_or_a_file_of_them(tmp_path):
    study = tmp_path / "study.toml"
    study.write_text(preset_text("quick"))
    assert load_sound(study) == load_study(study)
    alone = tmp_path / "alone.toml"
    alone.write_text(
        '[study]\nname = "s"\n[ocean]\nsource = "sea.nc"\n[acoustics]\narrival = "first"\n'
    )
    sound = load_sound(alone)
    assert sound.ocean.source == (str(tmp_path / "sea.nc"),)
    assert sound.acoustics.arrival == "first"
    alone.write_text('[ocean]\nsource = "sea.nc"\n[acoustic]\narrival = "first"\n')
    with pytest.raises(
        StudyError, match=r"alone\.toml: `acoustic`: unknown key. Did you mean `acoustics`\?"
    ):
        load_sound(alone)


def test_what_ranging_refuses_is_refused_without_a_fleet(tmp_path):
    file = tmp_path / "loud.toml"
    file.write_text(
        '[ocean]\nsource = "synthetic:fram"\n'
        '[acoustics]\nsurface_loss = "bubbles"\n'
        "[detection]\nsource_level_db = 185.0\nfrequency_hz = 25e3\nbandwidth_hz = 5e3\n"
    )
    with pytest.raises(
        StudyError,
        match=r"acoustics\.surface_loss is bubbles, but acoustics\.max_surface_bounces is 0",
    ):
        load_sound(file)


def test_unknown_preset_lists_those_there_are():
    with pytest.raises(
        StudyError,
        match=r"no preset 'fast'; allowed: beaufort, estimators-beaufort, estimators-fram, fram,"
        r" quick, survey",
    ):
        load_study("fast")
    with pytest.raises(
        StudyError, match=r"no preset 'beufort'; did you mean beaufort[?] allowed: beaufort, "
    ):
        load_study("beufort")


@pytest.mark.parametrize(("content", "expected"), [
    (None, "no such file"),
    (b"\xff", "cannot be read: not UTF-8 text"),
    (b"[study\n", "not valid TOML: Expected"),
    (b"a = " + b"[" * 3000 + b"]" * 3000,
     "not valid TOML: a number is too long, or tables are nested"),
    (b"a = " + b"9" * 5000, "not valid TOML: a number is too long, or tables are nested"),
    (b".".join([b"a"] * 100) + b" = 1", "`a`: unknown key"),
    (b".".join([b"a"] * 3000) + b" = 1", ""),  # Python 3.14 reads keys of at most 1000 parts
    (b"[study]\nname = " + b"[" * 90 + b"]" * 90, "study.name: found [[[[[[[...]]]]]]]"),
    (b'[study]\nname = "' + b"/" * 9999 + b'"', "study.name: found '///////"),
    (b"[study]\nseed = -" + b"9" * 4000, "study.seed: found -99999"),
], ids=range(10))  # fmt: skip
def test_files_that_are_no_configuration_are_named_in_short_lines(tmp_path, content, expected):
    if content is not None:
        (tmp_path / "mine.toml").write_bytes(content)
    with pytest.raises(StudyError) as caught:
        load_study(tmp_path / "mine.toml")
    assert f"mine.toml: {expected}" in str(caught.value)
    assert (
        max(len(line.replace(str(tmp_path), "")) for line in str(caught.value).splitlines()) < 250
    )


def test_invalid_file_names_and_endless_files_are_refused():
    refused(StudyError, r"a\\x00\.toml: cannot be read: .*embedded null", load_study, "a\0.toml")
    refused(StudyError, "/dev/zero: not a regular file", load_study, "/dev/zero")


def test_a_text_for_a_number_of_realizations_is_refused():
    refused(StudyError, "study.realizations: found 'x'; ", load_study, "quick", realizations="x")


def test_configuration_prints_as_one_short_line(quick):
    config = load_study("quick")
    assert str(config) == repr(config)
    assert repr(config) == (
        "<StudyConfig quick: 11 vehicles, 24 h, 3 realizations, ocean synthetic:beaufort>"
    )
    quick["fleet"]["vehicles"] = quick["fleet"]["vehicles"][:1]
    quick["study"]["realizations"] = 1
    assert ": 1 vehicle, 24 h, 1 realization, " in repr(parse_study(quick))


def test_input_files_are_relative_to_the_configuration(quick, tmp_path):
    quick["ocean"].update(source=["a.nc", "/abs/b.nc"], bathymetry="floor.nc")
    modes = {"count": 1, "casts": ["a.csv", "b.csv"]}
    quick["conditions"] = [{"name": "e"} | rays(EXACT, modes=modes)]
    (tmp_path / "mine.toml").write_text(tomli_w.dumps(quick))
    config = load_study(tmp_path / "mine.toml")
    a, floor, *casts = (str(tmp_path / name) for name in ("a.nc", "floor.nc", "a.csv", "b.csv"))
    assert config.ocean.files == (a, "/abs/b.nc", floor)
    assert config.files == (*config.ocean.files, *casts)
    quick["ocean"]["source"] = "synthetic:beaufort"
    (tmp_path / "mine.toml").write_text(tomli_w.dumps(quick))
    ocean = load_study(tmp_path / "mine.toml").ocean
    assert (ocean.synthetic, ocean.files) == (True, (floor,))
    quick["mission"]["schedule"] = {"kind": "pings", "file": "pings.csv"}
    pings, track = (str(tmp_path / name) for name in ("pings.csv", "track.csv"))
    study = build_study(parse_study(quick, folder=tmp_path))
    assert (study.ranging.files, study.fleet.files) == ((pings,), (pings,))
    quick["fleet"], quick["mission"] = {"trajectories": "track.csv"}, {"ping_interval_h": 1.0}
    study = build_study(parse_study(quick, folder=tmp_path))
    assert (study.ranging.files, study.fleet.files) == ((track,), (track,))
    assert build_study(load_study("quick")).fleet.files == ()


def test_ocean_files_of_a_tree_are_relative_to_the_working_folder(quick, tmp_path, monkeypatch):
    """Whoever reads the configuration in the run's folder has to find them."""
    monkeypatch.chdir(tmp_path)
    quick["ocean"].update(source=["a.nc", "/abs/b.nc"], bathymetry="c.nc")
    config = parse_study(quick)
    assert config.ocean.files == (str(tmp_path / "a.nc"), "/abs/b.nc", str(tmp_path / "c.nc"))
    assert parse_study(tomllib.loads(study_toml(config)), folder=tmp_path / "elsewhere") == config


def test_overrides_replace_realizations_and_ocean(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    config = load_study("quick", realizations=7, ocean=["x.nc"])
    assert config.study.realizations == 7
    assert config.ocean.files == (str(tmp_path / "x.nc"),)
    with pytest.raises(
        StudyError, match=r"quick: study\.realizations: found 0; allowed: 1 or more"
    ):
        load_study("quick", realizations=0)


def test_a_copy_is_checked_as_a_file_is():
    quick = load_study("quick")
    study = quick.model_copy(update={"noise": quick.noise.model_copy(update={"range_sigma": 50.0})})
    assert study.noise.range_sigma == 50.0
    assert study.model_fields_set == quick.model_fields_set | {"noise"}
    assert quick.model_copy(update={"mission": {"duration_h": "8 h"}}).mission.duration_h == 8.0
    assert quick.model_copy() == quick
    for model, update, line in (
        (
            quick.noise,
            {"rnge_sigma": 50.0},
            r"NoiseSection: `rnge_sigma`: unknown key. Did you mean `range_sigma`\?",
        ),
        (
            quick.noise,
            {"range_sigma": -1.0},
            r"NoiseSection: range_sigma: found -1\.0; allowed: greater than 0",
        ),
        (quick, {"nose": 1}, r"StudyConfig: `nose`: unknown key. Did you mean `noise`\?"),
        (quick.mission, {"duration_h": "long"}, "MissionSection: duration_h: .*'long'"),
        (quick.ocean, {"centre_lat": 1.0, "centre_lon": None}, "must be given together"),
    ):
        refused(StudyError, line, model.model_copy, update=update)


def test_the_first_ping_may_be_at_the_start(tiny):
    times = {
        start: build_pings(tiny(mission={"ping_start_h": start}))
        .schedule.times(4.0 * 3600.0)
        .tolist()
        for start in ("none", 0.0, "30 min")
    }
    assert times == {
        "none": [3600.0, 7200.0, 10800.0, 14400.0],
        0.0: [0.0, 3600.0, 7200.0, 10800.0, 14400.0],
        "30 min": [1800.0, 5400.0, 9000.0, 12600.0],
    }
    assert keys_of_schedule(PingSchedule(600.0, start=60.0)) == {
        "ping_interval_h": 600.0 / 3600.0,
        "ping_start_h": 60.0 / 3600.0,
    }
    for start, refusal in (
        (0.01, "ping_start_h is 36 s; it must be a whole multiple"),
        (-1.0, "0 or more"),
    ):
        with pytest.raises(StudyError, match=refusal):
            tiny(mission={"ping_start_h": start})


def test_gtsam_replaces_the_batch_solver_for_straight_ranges():
    config = load_study("quick", solver="gtsam")
    assert (config.solver.kind, config.solver.converged) == ("gtsam", True)
    kinds = {c.name: config.solver_of(c).kind for c in config.conditions}
    assert kinds == {"odometry": "dead-reckoning", "straight": "gtsam", "refracted": "gtsam"}
    assert not load_study("quick", solver={"kind": "gtsam", "converged": False}).solver.converged
    assert load_study("quick").solver.kind == "batch"
    rays = {"name": "rays", "range_model": {"kind": "eigenray", "belief": "exact"}}
    for more, why in (
        (rays, "range_model is eigenray"),
        ({"name": "biased", "bias_sigma": 50.0}, "biases"),
        ({"name": "graduated", "loss": "gnc"}, "loss gnc"),
    ):
        changes = {"solver": "gtsam", "conditions": ["straight", more]}
        refused(
            StudyError,
            f"condition {more['name']} cannot use it.*{why}",
            load_study,
            "quick",
            **changes,
        )


@pytest.mark.parametrize("name", ["beaufort", "fram", "quick"])
def test_presets_have_the_choices_of_the_authors_program(name):
    """Where the paper is silent; these are also the defaults of a study of one's own."""
    config = load_study(name)
    assert config.ocean.time.isoformat() == "2014-07-15T00:00:00"
    floats, mission = config.fleet.floats, config.mission
    assert (floats.surface_depth, floats.depth_gain, mission.gnss_depth) == (0.01, 10.0, 0.1)
    (station,) = (v for v in config.fleet.vehicles if isinstance(v, StationVehicle))
    assert station.depth == 0.01
    assert (floats.surface_depth, floats.depth_gain) == (
        FloatSection().surface_depth,
        FloatSection().depth_gain,
    )
    assert mission.gnss_depth == MissionSection().gnss_depth
    cycle = build_vehicles(config.fleet)[1].behaviour
    assert (cycle.surface_depth, cycle.depth_gain) == (0.01, 10.0)
    assert (FloatCycle(99.0).surface_depth, FloatCycle(99.0).depth_gain) == (0.01, 10.0)


def names_of(tree):
    return [condition.name for condition in parse_study({**TINY, **tree}).conditions]


def test_a_list_of_conditions_replaces_the_default_one():
    assert names_of({"conditions": ["odometry", {"name": "e"}]}) == ["odometry", "e"]
    tables = {
        "e": {"range_sigma": 5.0},
        "straight": "none",
        "odometry": {"start": "dead-reckoning"},
    }
    config = parse_study({**TINY, "conditions": tables})
    assert [condition.name for condition in config.conditions] == ["odometry", "refracted", "e"]
    assert config.conditions[0].start == "dead-reckoning"
    assert names_of({"conditions": "none"}) == []


@pytest.mark.parametrize("odd", [3, "odd", [3], {"e": 3}])
def test_what_is_no_list_of_conditions_is_refused(odd):
    with pytest.raises(StudyError):
        parse_study({**TINY, "conditions": odd})


@pytest.mark.parametrize(("key", "expected"), [
    ("ocean.centre_latitude", "unknown key. Did you mean `ocean.centre_lat`?"),
    ("noise.clock_ofset_sigma", "unknown key. Did you mean `noise.clock_offset_sigma`?"),
])  # fmt: skip
def test_an_unknown_key_gets_the_nearest_one_as_a_suggestion(key, expected):
    refused(StudyError, re.escape(expected), load_study, "quick", **{key: 1.0})
