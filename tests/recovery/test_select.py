"""Structure search: finds the true structure, prefers the smaller of equals, survives a kill."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from often import often
from scipy.signal import lfilter

import sysid
from sysid.base.errors import InputError
from sysid.data.preprocess import detrend
from sysid.selection.folds import Fold, folds
from sysid.selection.judge import Effort, Job, judge
from sysid.selection.select import select
from sysid.selection.space import Space
from sysid.selection.table import Row, choose_by_kind, ranked
from sysid.structures import ActuatedJoint, Hammerstein, HammersteinWiener, OutputError, ProcessModel
from sysid.systems import system
from sysid.workflow import identification

BLOCKS = ("output_error", "hammerstein", "wiener", "hammerstein_wiener")
SMALL = Space(
    nb=(1, 2),
    nf=(1, 2),
    nk=(1, 2),
    input=("unit_gain", "saturation"),
    output=("unit_gain", "dead_zone"),
    starts=1,
    structures=(*BLOCKS, "actuated_joint"),
    grows=False,
)


def hammerstein_record(N=1200, seed=0):
    """Saturation at +-1 and two poles: what `SMALL` holds as hammerstein (2,2,1) saturation."""
    chain = sysid.structures.hammerstein(2, 2, 1, "saturation")
    theta = np.array([-1.0, 1.0, 0.3, 0.15, -1.5, 0.7, 0.0, 0.0])
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-2, 2, N // 5), 5)
    y = chain.simulate(theta, u)
    return sysid.IOData(u, y + 0.02 * y.std() * rng.normal(size=N), 0.1)


@pytest.mark.parametrize("seed", often(4, 1))
def test_the_true_structure_wins(seed):
    found = select(hammerstein_record(seed=seed), SMALL, jobs=1)
    assert found.chosen.candidate == Hammerstein(2, 2, 1, "saturation")
    assert found.chosen.fit_percent > 97.5  # 98 is what the noise leaves
    assert str(found.chosen.candidate) in found.sentence()
    np.testing.assert_allclose(np.sort_complex(found.fit.poles), np.sort_complex(np.roots([1, -1.5, 0.7])), atol=0.01)


@pytest.mark.nightly
@pytest.mark.parametrize(("kind", "seed"), [("P1D", 0), ("P2D", 1)])
def test_a_plant_with_a_delay_between_two_samples_is_a_process_of_its_kind(kind, seed):
    """In seconds of the record, at another sampling time than the block's own."""
    rng = np.random.default_rng(seed)
    times, Ts = {"P1D": {"T1": 0.9}, "P2D": {"T1": 0.9, "T2": 0.5}}[kind], 0.1
    chain = sysid.structures.process(kind, offset="none").sampled(Ts)
    values = {"K": 2.0, "Td": 0.537, **times}
    u = np.repeat(rng.uniform(-1.0, 1.0, 30), 20)
    y = chain.simulate(np.array([values.get(name.removeprefix("plant."), 0.0) for name in chain.names]), u)
    space = replace(SMALL, nk=(5, 6), structures=("output_error", "process"))
    found = select(sysid.IOData(u, y + 0.02 * y.std() * rng.normal(size=len(y)), Ts), space, jobs=1)
    assert str(found.chosen.candidate) == f"process {kind}"
    by_name = {p.name.removeprefix("plant."): p.value for p in found.fit.parameters}
    for name, value in values.items():
        assert by_name[name] == pytest.approx(value, rel=0.1), name
    assert found.best_of_each[-1].candidate.name == "output_error"


def test_a_search_begins_with_processes_at_the_sampling_time_of_the_record():
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1.0, 1.0, 20), 15)
    y = lfilter([0.0, 0.2], [1.0, -0.9], u)  # a time constant of 0.0949 s
    data = sysid.IOData(u, y + 0.01 * rng.normal(size=len(u)), 0.01)
    firsts = [c for c in Space().ladders(data) if isinstance(c, ProcessModel)]
    assert [c.kind for c in firsts] == ["P1D", "P2D", "P2DU", "P1DI"]
    row = judge(Job(firsts[0], folds(data), Effort(1, 4), "auto", 0, 1, True))  # its start is near
    assert row.fit_percent > 96.0
    assert all(theta[1] == pytest.approx(0.0949, rel=0.05) for theta in row.thetas)


@pytest.mark.parametrize("seed", often(4, 1))
def test_a_lag_with_a_delay_is_whole_on_the_parts_of_a_record(seed):
    """Without noise, of inputs that stand for 25 to 60 samples and delays of up to 12: what a delay held where a part
    begins was unknown there, so that the true model left errors, and one with a second lag was said to be better."""
    rng = np.random.default_rng(seed)
    holds = rng.integers(25, 60, 60)
    u = np.repeat(rng.uniform(0.0, 80.0, 60), holds)[:1000]
    a = np.exp(-1.0 / rng.uniform(10.0, 100.0))
    y = lfilter([*np.zeros(rng.integers(5, 13)), 1.0 - a], [1.0, -a], u)
    for fold in (pair := folds(sysid.IOData(u, y, 1.0))):
        assert min(fold.estimation.lengths) >= 75  # of 100 and more
    row = judge(Job(ProcessModel("P1D"), pair, Effort(1, 50), "auto", 0, 1, whole=True))
    assert row.fit_percent > 99.9


def test_of_equals_with_as_many_parameters_the_one_that_cannot_swing_is_handed_over():
    errors = np.random.default_rng(0).uniform(1.0, 2.0, 20)
    kinds = {"P2DU": (99.0, 7), "P2D": (98.999, 7), "P1D": (90.0, 5)}
    rows = [
        Row(ProcessModel(kind), fit, d, 3, errors * (1.0 if fit > 95.0 else 9.0), True)
        for kind, (fit, d) in kinds.items()
    ]
    assert ranked({r.candidate: r for r in rows})[1].candidate.kind == "P2D"
    alike = [replace(r, kinds=np.full(8, -3.0 - 1e-4 * r.candidate.swings)) for r in rows[:2]]
    assert choose_by_kind(alike).candidate.kind == "P2D"


def test_a_budget_that_is_over_early_has_tried_linear_models_and_processes():
    """And what it has tried holds the truth: a joint took the time of a cold start before, and was handed over."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1.0, 1.0, 40), 15)
    y = lfilter([*np.zeros(10), 0.05], [1.0, -0.9], u)
    data = sysid.IOData(u, y + 0.01 * y.std() * rng.normal(size=len(u)), 0.1)
    names = [c.name for c in Space().tasters(data)]
    assert {"output_error", "process"} == set(names[:2])
    assert names.index("nlarx") > names.index("hammerstein_wiener")
    assert {*names[-2:]} == {"actuated_joint", "servo_joint"}
    tried = []

    def over_after_three(done, total, name):
        tried.append(name)
        if len(tried) == 3:
            clock.now += 1000.0

    clock = SimpleNamespace(now=0.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sysid.selection.select.time.time", lambda: clock.now)
        found = select(data, Space(starts=1), jobs=1, seconds=100.0, progress=over_after_three)
    assert found.chosen.candidate.name == "process"


def test_larger_equals_are_named_and_passed_over():
    """Three poles run as well as two: the table says that they are equal, and two are chosen."""
    space = replace(SMALL, nb=(2,), nf=(2, 3), nk=(1,), input=("saturation",), output=("unit_gain",))
    found = select(hammerstein_record(), space, jobs=1)
    equals = {(r.candidate.orders["nf"], r.candidate.name) for r in found.rows if r.equal and r.candidate.orders}
    assert {(2, "hammerstein"), (3, "hammerstein")} <= equals
    assert found.chosen.candidate.orders["nf"] == 2
    linear = next(r for r in found.rows if r.candidate.name == "output_error")
    assert not linear.equal


def test_each_part_is_judged_by_the_model_of_the_other():
    """The plant turns its sign after half the record, noise-free: a model of one half says the other's negative, an
    error of twice the output and so -100 %; on its own half it would reach 100 %."""
    u = np.repeat(np.random.default_rng(2).choice([-1.0, 1.0], 240) * np.tile([1.0, 2.0], 120), 5)
    first, second = np.split(u, 2)
    y = np.concatenate([lfilter([0, 0.5], [1, -0.8], first), lfilter([0, -0.5], [1, -0.8], second)])
    one, other = sysid.IOData(u, y, 0.1).split(0.5)
    parts = Fold(one, other, 50), Fold(other, one, 50)
    row = judge(Job(OutputError(1, 1, 1), parts, Effort(1, 50), "auto", 0, 1, whole=True))
    assert row.fit_percent == pytest.approx(-100.0, abs=10.0)


def test_both_parts_of_a_record_meet_what_only_its_first_half_shows():
    """Positive levels stand in the first half alone, negative ones in the second: halves would judge every model beyond
    its data. No sample is in both parts, and none is lost."""
    levels = np.random.default_rng(0).uniform(0.2, 1.0, 80) * np.repeat([1.0, -1.0], 40)
    u = np.repeat(levels, 20)
    record = sysid.IOData(u, lfilter([0, 0.2], [1, -0.8], u), 0.1)
    first, second = folds(record)
    for fold in (first, second):
        for part in (fold.estimation, fold.unseen):
            assert part.y.min() < -0.7
            assert part.y.max() > 0.7
        both = np.concatenate([fold.estimation.y, fold.unseen.y])
        np.testing.assert_array_equal(np.sort(both, axis=0), np.sort(record.y, axis=0))
    np.testing.assert_array_equal(first.estimation.y, second.unseen.y)


def test_a_record_whose_halves_show_the_same_is_halved_and_experiments_stay_apart():
    """Where the input has stood still for longest, which is the last sample before a change."""
    u = np.tile(np.repeat(np.random.default_rng(0).uniform(-1, 1, 40), 20), 2)
    record = sysid.IOData(u, lfilter([0, 0.2], [1, -0.8], u), 0.1)
    assert [fold.estimation.lengths for fold in folds(record)] == [(799,), (801,)]
    two = sysid.IOData.merge(*record.split(0.5))
    assert [fold.unseen.lengths for fold in folds(two)] == [(800,), (800,)]


def test_the_input_moves_in_both_parts_or_the_search_is_refused():
    """Parts at rest would say of every structure that it knows nothing, and of the right one the least."""
    u = np.repeat([0.8, 0.6, 0.8], [250, 300, 50])
    early = sysid.IOData(u, lfilter([0, 0.1], [1, -0.95], u), 1.0)
    for fold in folds(early):
        assert max(np.ptp(e.u) for e in fold.estimation.experiments) > 0
    once = sysid.IOData(np.repeat([0.8, 0.6], [250, 350]), early.y, 1.0)
    with pytest.raises(sysid.InputError, match="the input moves too rarely for two such parts; name a structure"):
        folds(once)


def joint_record(N=1000, seed=0):
    """A motor between two stops, driven back and forth, on a scale whose means are not zero."""
    chain = sysid.structures.actuated_joint(knots=2, play=False)
    values = {"gain": 0.02, "lag": 0.8, "rise": 1.5, "fall": 1.0, "upper": 1.0, "x0": 0.5, "low": 2.0, "high": 5.0}
    theta = np.array([values.get(name.split(".")[1], 0.0) for name in chain.names])
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-6, 8, N // 10), 10)
    y = chain.simulate(theta, u)
    return sysid.IOData(u, y + 0.02 * rng.normal(size=N), 0.1)


def test_a_joint_is_tried_and_wins_where_the_record_integrates_and_stops():
    record = joint_record()
    found = select(detrend(record), SMALL, jobs=1)
    assert found.chosen.candidate == ActuatedJoint()
    assert str(ActuatedJoint()) == "actuated_joint"
    ends = {v.name: v.value for v in sysid.joint_values(found.fit) if v.name.startswith("end_")}
    assert ends == pytest.approx({"end_low": 2.0, "end_high": 5.0}, abs=0.02)  # on the record's own scale
    assert found.fit.fit_percent(record) > 97.0


@pytest.mark.nightly
def test_every_structure_keeps_its_best_row_and_one_that_is_not_asked_for_has_none():
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-2, 2, 200), 5)
    chain = sysid.structures.output_error(2, 2, 1)
    y = chain.simulate(np.array([0.3, 0.15, -1.5, 0.7, 0.0, 0.0]), u)
    record = sysid.IOData(u, y + 0.02 * y.std() * rng.normal(size=1000), 0.1)
    found = select(record, SMALL, jobs=1)
    assert {r.candidate.name for r in found.best_of_each} == set(SMALL.structures)
    assert found.chosen.candidate == OutputError(2, 2, 1, offset="free")
    for best in found.best_of_each:
        others = [r.fit_percent for r in found.rows if r.candidate.name == best.candidate.name and r.whole]
        assert best.fit_percent == max(others)
    none = select(record, replace(SMALL, structures=BLOCKS), jobs=1)
    assert ActuatedJoint() not in {r.candidate for r in none.rows}


@pytest.mark.nightly
def test_a_joint_that_a_search_finds_has_all_parts_on_the_scale_of_the_file(tmp_path, monkeypatch):
    record = joint_record(600)
    np.savetxt(tmp_path / "joint.csv", np.column_stack([record.u, record.y]), delimiter=",", header="u,y", comments="")
    monkeypatch.setattr(identification, "Space", lambda starts: replace(SMALL, starts=starts))
    found = identification.identify_file(tmp_path / "joint.csv", identification.Auto("lm", 1), "u", "y", Ts=0.1)
    assert found.selection.chosen.candidate == found.evaluation.setting.recipe == ActuatedJoint()
    assert found.detrend == "none"
    assert found.evaluation.joint_fit is not None
    np.testing.assert_allclose(found.evaluation.estimation.y, record.y[:300], atol=1e-12)
    ends = {v.name: v.value for v in found.evaluation.values if v.name.startswith("end_")}
    assert ends == pytest.approx({"end_low": 2.0, "end_high": 5.0}, abs=0.05)


def test_every_structure_is_tried_with_exactly_the_maps_that_it_has_places_for():
    """And no linear model with more zeros than a sampled plant of that many poles has."""
    space = replace(SMALL, nb=(1, 2, 3), nf=(1,), nk=(1,), kept_orders=1)
    found = select(hammerstein_record(400), space, jobs=1)
    first = {str(r.candidate) for r in found.rows if r.candidate.name == "output_error"}
    assert first == {"output_error (1,1,1)", "output_error (2,1,1)"}
    kinds = {(r.candidate.name, *r.candidate.maps.values()) for r in found.rows}
    assert kinds == {
        ("output_error",),
        ("actuated_joint",),
        ("hammerstein", "saturation"),
        ("wiener", "dead_zone"),
        ("hammerstein_wiener", "saturation", "dead_zone"),
    }


@pytest.mark.nightly
@pytest.mark.long
@pytest.mark.slow
def test_the_textbook_plant_among_all_default_maps():
    record = system("textbook").record(1500, 0.02, np.random.default_rng(1))
    found = select(record, Space(starts=2, structures=BLOCKS), jobs=1, seconds=240.0)  # also on a busy machine
    assert found.chosen.candidate == HammersteinWiener(2, 2, 1, "saturation", "piecewise_linear")


@pytest.mark.nightly
def test_a_killed_search_goes_on_and_ends_as_if_it_had_not_been(tmp_path):
    data, journal = hammerstein_record(), tmp_path / "search.jsonl"
    every: list[str] = []
    whole = select(data, SMALL, jobs=1, progress=lambda *a: every.append(a[2]))
    names: list[str] = []

    def kill(done, total, name):
        names.append(name)
        if len(names) == 6:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        select(data, SMALL, jobs=1, journal=journal, progress=kill)
    with journal.open("a") as file:
        file.write('{"key": "cut sho')  # as a kill in the middle of a write leaves it
    again: list[str] = []
    resumed = select(data, SMALL, jobs=1, journal=journal, progress=lambda *a: again.append(a[2]))
    assert names + again == every  # the six linear models of the first round are not done twice
    assert [r.candidate for r in resumed.rows] == [r.candidate for r in whole.rows]
    assert [r.fit_percent for r in resumed.rows] == [r.fit_percent for r in whole.rows]
    untouched: list[str] = []
    select(data, SMALL, jobs=1, journal=journal, progress=lambda *a: untouched.append(a[2]))
    assert untouched == []


def test_numbers_do_not_depend_on_the_number_of_processes():
    data, space = hammerstein_record(600), replace(SMALL, nb=(2,), structures=BLOCKS)
    one, two = select(data, space, jobs=1), select(data, space, jobs=2)
    assert one.as_dict() == two.as_dict()


def test_a_journal_of_something_else_is_refused(tmp_path):
    journal = tmp_path / "search.jsonl"
    space = replace(SMALL, nb=(2,), nf=(2,), nk=(1,), structures=("output_error",))
    select(hammerstein_record(600), space, jobs=1, journal=journal)
    with pytest.raises(InputError, match="another record"):
        select(hammerstein_record(600, seed=1), space, jobs=1, journal=journal)
    journal.write_text("angle,voltage\n1,2\n")
    with pytest.raises(InputError, match="not a journal"):
        select(hammerstein_record(600), space, jobs=1, journal=journal)
    with pytest.raises(InputError, match="another path"):
        select(hammerstein_record(600), space, jobs=1, journal=tmp_path / "none" / "search.jsonl")


def test_where_nothing_can_be_fitted_it_says_why_and_what_helps():
    """The input moves once, so that one half of the record has a constant one."""
    rng = np.random.default_rng(0)
    u = np.full(150, 8.98)
    u[20:24] = 3.0
    data = sysid.IOData(u, rng.standard_normal(150), Ts=0.1)
    with pytest.raises(
        InputError, match=r"of the 150 samples .* input moves too rarely for two such parts.*--split 0\.7"
    ):
        select(data, SMALL, jobs=1)
