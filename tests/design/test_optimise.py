import math
import warnings

import jax.numpy as jnp
import numpy as np
import pytest
from small_problems import BOWL, SUM, cart, numbers, problem, quantity

import jaxkin as jk
from jaxkin.design import Measured, Objective, constrained, gradient_steps, optimise

QUICK = {"starts": 4, "steps": 40, "refine": 2, "neighbours": 50, "progress": False}


def isotropy(norm):
    tlpm = jk.mechanisms.tlpm.create
    robot = tlpm(590.0, 590.0)
    home = jk.design.poses(robot, [0.0, 0.0, 0.0])
    wanted = jk.design.inverse_condition_number(robot, home, norm=norm)
    vary = {"base_radius": (300.0, 900.0)}
    return jk.design.Problem(robot, vary, maximise=wanted, build=lambda base_radius: tlpm(base_radius, 590.0))


# What was seen as |L/h - sqrt 2|: Frobenius 0 (auto, slsqp), 2e-16 (trust-constr), 1e-8 (lbfgs, whose line search sees
# values, and these are flat to rounding there), 8e-6 (adam); spectral, with a kink, 7e-13 (auto), 1e-13 (slsqp), 5e-10
# (trust-constr), 5e-11 (lbfgs), 4e-6 (adam).
@pytest.mark.parametrize(
    ("norm", "method"),
    [
        ("frobenius", "auto"),
        ("frobenius", "slsqp"),
        ("frobenius", "trust-constr"),
        pytest.param("spectral", "auto", marks=pytest.mark.slow),
        pytest.param("spectral", "slsqp", marks=pytest.mark.slow),
        pytest.param("spectral", "trust-constr", marks=pytest.mark.slow),
        pytest.param("spectral", "lbfgs", marks=pytest.mark.slow),
    ],
)
def test_the_tlpm_is_isotropic_at_home_where_its_radius_is_sqrt_2_heights(norm, method):
    design = optimise(isotropy(norm), method=method, **{**QUICK, "starts": 3, "steps": 200, "refine": 1})
    assert design.values["base_radius"] / 590.0 == pytest.approx(math.sqrt(2), abs=1e-8)
    assert design.objective.value == pytest.approx(1.0, abs=1e-8)
    assert float(design.robot.initial_lengths[0]) == pytest.approx(590.0 * math.sqrt(3), abs=1e-5)
    assert design.verified
    assert design.active == ()


@pytest.mark.parametrize(
    ("method", "tolerance"),
    [("auto", 1e-12), ("slsqp", 1e-12), ("trust-constr", 1e-12), ("lbfgs", 1e-7), ("adam", 1e-2)],
)
def test_a_bowl_inside_its_bounds(method, tolerance):
    design = optimise(problem(), method=method, **{**QUICK, "steps": 100})
    assert design.values == pytest.approx({"a": 1.0, "b": 2.0}, abs=tolerance)
    assert design.feasible
    assert design.bounds == {}
    assert design.request["options"]["method"] == method


def flattering(width, honest):
    """A distance to (1, 2) whose smoothing makes it smaller by up to a width; an honest one says so."""

    def parts(robot, center):
        del center
        square = (robot.a - 1.0) ** 2 + (robot.b - 2.0) ** 2
        return (jnp.sqrt(square + width**2) - width)[None]

    def measured(robot, center):
        away = math.hypot(float(robot.a) - 1.0, float(robot.b) - 2.0)
        return Measured(away, 1e-15, smoothed=float(parts(robot, center)[0]) if honest else None)

    return Objective("distance", "1", parts, "only", 0.0, "smooth", measured)


# With a + b at most 2.9 the distance is 0.0707, smoothed 0.0225.
@pytest.mark.parametrize(("most", "honest", "good"), [(9.0, True, True), (2.9, True, True), (2.9, False, False)])
def test_what_smoothing_explains_is_no_failure(most, honest, good):
    design = optimise(problem(minimise=flattering(0.1, honest), subject_to=[SUM.at_most(most)]), **QUICK)
    assert design.objective.value == pytest.approx(max(0.0, (3.0 - most) / math.sqrt(2)), abs=1e-12)
    assert design.verified is good
    assert good or design.failures == ("The smoothed distance is better by 0.0482 than what was measured.",)


def test_how_much_smoothing_flatters():
    worst = Objective("worst", "1", lambda *_: jnp.zeros(4), "least", 0.5, "", lambda *_: Measured(0.0, 0.0))
    assert worst.flattery(4, 1.0) == 0.0
    assert worst.flattery(4, -1.0) == pytest.approx(0.5 * math.log(4))


@pytest.mark.parametrize("method", ["auto", "slsqp", "trust-constr"])
def test_active_bounds_and_requirements_are_named(method):
    bound = optimise(problem({"a": (1.5, 3.0), "b": (0.0, 3.0)}), method=method, **QUICK)
    assert bound.values == pytest.approx({"a": 1.5, "b": 2.0}, abs=1e-10)
    assert bound.bounds == {"a": "low"}
    assert bound.active == ("a >= 1.5",)
    assert bound.verified
    kept = optimise(problem(subject_to=[SUM.at_most(2.0)]), method=method, **QUICK)
    assert kept.values == pytest.approx({"a": 0.5, "b": 1.5}, abs=1e-9)
    assert kept.objective.value == pytest.approx(0.5, abs=1e-9)
    assert kept.active == ("sum <= 2",)
    assert kept.verified
    assert kept.stationarity < 1e-10
    loose = optimise(problem(subject_to=[SUM.at_most(5.0)]), method=method, **QUICK)
    assert loose.active == ()
    assert loose.requirements[0].slack == pytest.approx(2.0, abs=1e-9)


@pytest.mark.parametrize("method", ["auto", "adam", "slsqp"])
def test_a_problem_without_solution_gives_what_violates_least(method):
    asked = problem(subject_to=[SUM.at_least(10.0)])
    with pytest.warns(
        jk.InfeasibleWarning, match=r"best of 4 searches, a=3, b=3, misses sum >= 10, by 4\. If there is"
    ):
        design = optimise(asked, method=method, **{**QUICK, "steps": 100})
    assert not design.verified
    assert not design.feasible
    assert design.values == pytest.approx({"a": 3.0, "b": 3.0}, abs=1e-6)
    assert any("sum >= 10 is missed by 4" in text for text in design.failures)
    assert "NOT VERIFIED" in str(design)
    assert design.to_json()["verified"] is False


def test_a_pose_beyond_the_limits_of_all_designs_is_named_before_the_first_step():
    # x = a q + b with |q| <= 5: no q serves x = 40.
    robot = cart()
    kept = jk.design.limit_margin(robot, jk.design.poses(robot, [[0.5], [40.0]])).at_least(0.0)
    missed = r"a=3, b=3, misses limit margin >= 0 length, by 7\.333 at \(40\)\."
    with pytest.warns(jk.InfeasibleWarning, match=missed):
        design = optimise(problem(subject_to=[kept]), **QUICK)
    assert not design.feasible


def test_requirements_that_two_designs_of_a_thousand_keep_are_met():
    narrow = quantity("well", lambda a, b: (a - 2.0) ** 2 + (b - 1.0) ** 2).at_most(1e-4)
    apart = quantity("gap", lambda a, b: a - b).at_least(1.0)
    design = optimise(problem(subject_to=[narrow, apart]), method="adam", **{**QUICK, "starts": 2})
    assert design.feasible
    assert design.counts["starts"] == 3


def test_a_design_that_keeps_requirements_but_is_no_number_is_no_start():
    root = quantity("root", lambda a, b: jnp.sqrt(a - 1.0) + b)
    ring = quantity("ring", lambda a, b: (a - 0.95) ** 2 + (b - 1.0) ** 2).at_most(0.0099)
    options = {**QUICK, "starts": 4, "method": "slsqp"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jk.InfeasibleWarning)
        design = optimise(problem(minimise=root, subject_to=[ring]), **options)
    assert np.isfinite(design.objective.value)
    assert design.values["a"] >= 1.0


def test_what_the_proof_would_accept_is_no_reason_to_warn():
    # No design is inside: the set of those that keep both is a line.
    line = [SUM.at_least(2.0), quantity("square", lambda a, b: (a + b) ** 2).at_most(4.0)]
    assert optimise(problem(subject_to=line), **QUICK).verified
    # Smoothing on the safe side: measured, it is kept.
    safe = Objective("sum", "1", SUM.parts, "only", 0.0, "", lambda r, c: Measured(float(r.a + r.b) + 0.5, 1e-15))
    assert optimise(problem(subject_to=[safe.at_least(6.2)]), **QUICK).feasible


def test_starts_that_are_no_numbers_are_left_out():
    some = quantity("root", lambda a, b: jnp.sqrt(a - 1.0) - b)
    design = optimise(problem(minimise=some), **{**QUICK, "starts": 9})
    assert 0 < design.counts["starts"] < 9
    assert design.values == pytest.approx({"a": 1.0, "b": 3.0}, abs=1e-2)
    none = quantity("root", lambda a, b: jnp.sqrt(-a - 1.0) + b)
    with pytest.raises(jk.InputError, match=r"The root is not a finite number at any of the 4 starts, a=0\.7, b=0\.9"):
        optimise(problem(minimise=none), **QUICK)
    with pytest.raises(jk.InputError, match="requirement root >= 0 is not a finite number at any"):
        optimise(problem(subject_to=[none.at_least(0.0)]), **QUICK)


def test_a_pose_out_of_reach_of_all_designs_is_named():
    robot = jk.mechanisms.five_bar.create(9.0, (8.0, 8.0), (5.0, 5.0))
    place = jk.design.poses(robot, [[4.5, 6.0], [4.5, 40.0]])
    wanted = jk.design.smallest_singular_value(robot, place, mode=(1, 1))
    asked = jk.design.Problem(robot, vary={"proximal": (6.0, 9.0)}, maximise=wanted)
    with pytest.raises(jk.InputError, match=r"pose \(x=4\.5, y=40\).* out of reach of all of 1024 designs"):
        optimise(asked, **QUICK)


def test_it_stops_early_where_nothing_gets_better():
    design = optimise(problem(minimise=SUM), method="adam", **{**QUICK, "steps": 2000})
    assert design.counts["stopped early"]
    assert design.history.sizes["step"] < 300
    assert design.values == pytest.approx({"a": 0.0, "b": 0.0}, abs=1e-12)
    assert design.bounds == {"a": "low", "b": "low"}


def test_a_seed_gives_the_same_bits_and_another_does_not():
    first, again, other = (optimise(problem(), seed=seed, **QUICK) for seed in (3, 3, 4))
    assert numbers(first) == numbers(again)
    assert numbers(first)[1] != numbers(other)[1]
    assert first.request["options"]["seed"] == 3
    assert other.values == pytest.approx(first.values, abs=1e-10)


def test_the_history_has_every_step_of_every_start():
    design = optimise(problem(subject_to=[SUM.at_most(2.0)]), **{**QUICK, "steps": 30})
    history = design.to_dataset()
    assert dict(history.sizes)["step"] == 40  # Rounded up to chunks of 20.
    assert history.objective.shape == history.violation.shape == history.a.shape == (40, 4)
    assert history.refined_objective.shape == history.refined_a.shape == (history.sizes["iterate"],)
    best = history.best.values
    assert np.all(np.diff(best[np.isfinite(best)]) <= 0)
    value = (history.a - 1.0) ** 2 + (history.b - 2.0) ** 2
    np.testing.assert_allclose(history.objective, value, atol=1e-13)
    np.testing.assert_allclose(history.violation, np.maximum(history.a + history.b - 2.0, 0.0) / 2.0, atol=1e-1)


def stop_at(monkeypatch, owner, name, call):
    """Makes a function raise Ctrl-C at a call."""
    plain, calls = getattr(owner, name), []

    def stopping(*arguments, **options):
        calls.append(1)
        if len(calls) == call:
            raise KeyboardInterrupt
        return plain(*arguments, **options)

    monkeypatch.setattr(owner, name, stopping)


STAGES = [
    (gradient_steps.Steps, "chunk", 1),
    (gradient_steps.Steps, "chunk", 2),
    (constrained.Hard, "solve", 2),
    (constrained.Hard, "polished", 2),
]


@pytest.mark.parametrize(("owner", "name", "call"), STAGES)
def test_a_stopped_run_keeps_its_best_and_goes_on_to_the_same_bits(monkeypatch, tmp_path, owner, name, call):
    asked = problem(subject_to=[SUM.at_most(2.0)])
    whole = optimise(asked, **QUICK)
    path = tmp_path / "kept.npz"
    with monkeypatch.context() as patch:
        stop_at(patch, owner, name, call)
        with pytest.raises(jk.design.OptimisationInterrupted, match="best design so far") as caught:
            optimise(asked, checkpoint=path, **QUICK)
    stopped = caught.value.design
    assert isinstance(caught.value, KeyboardInterrupt)
    assert not stopped.verified
    assert stopped.failures == ("The optimisation was stopped.",)
    assert ("goes on at its checkpoint" in str(caught.value)) == path.exists()
    assert numbers(optimise(asked, checkpoint=path, **QUICK)) == numbers(whole)
    assert numbers(optimise(asked, checkpoint=path, **QUICK)) == numbers(whole)


@pytest.mark.parametrize("where", ["checked_starts", "verified"])
def test_ctrl_c_before_and_after_the_search(monkeypatch, where):
    # The module, which the function of its name hides.
    module = __import__("sys").modules["jaxkin.design.optimise"]
    stop_at(monkeypatch, module, where, 1)
    with pytest.raises(jk.design.OptimisationInterrupted) as caught:
        optimise(problem(), **QUICK)
    expected = {"a": 0.7, "b": 0.9} if where == "checked_starts" else {"a": 1.0, "b": 2.0}
    assert caught.value.design.values == pytest.approx(expected, abs=1e-10)


def test_checkpoints_of_other_requests_and_damaged_ones_are_refused(tmp_path):
    path = tmp_path / "kept.npz"
    first = optimise(problem(), checkpoint=path, **QUICK)
    with pytest.raises(jk.StoreError, match=r"another request \(options\.seed is 0 there and 1 here\)"):
        optimise(problem(), checkpoint=path, seed=1, **QUICK)
    with pytest.raises(jk.StoreError, match="another request"):
        optimise(problem(subject_to=[SUM.at_most(2.0)]), checkpoint=path, **QUICK)
    whole = path.read_bytes()
    one = tmp_path / "one.npy"
    np.save(one, np.zeros(3))
    for damaged in (b"", b"text", whole[: len(whole) // 2], one.read_bytes()):
        path.write_bytes(damaged)
        with pytest.raises(jk.StoreError, match=r"cannot be read .*overwrite=True"):
            optimise(problem(), checkpoint=path, **QUICK)
    assert numbers(optimise(problem(), checkpoint=path, overwrite=True, **QUICK)) == numbers(first)


OPTIONS = [
    ({"method": "newton"}, "method is 'newton': choose among auto, adam"),
    ({"starts": 0}, "starts is 0: it must be a whole number, at least 1"),
    ({"steps": 1.5}, "steps is 1.5"),
    ({"seed": -1}, "seed is -1"),
    ({"rate": 0.0}, "rate is 0.0: it must be a positive number"),
    ({"tolerance": float("nan")}, "tolerance is nan"),
]


@pytest.mark.parametrize(("options", "message"), OPTIONS)
def test_options_out_of_range(options, message):
    with pytest.raises(jk.InputError, match=message):
        optimise(problem(), **options)


def test_what_is_no_problem():
    with pytest.raises(jk.InputError, match=r"got a Cart: it must be a jk\.design\.Problem"):
        optimise(cart())
    assert BOWL(cart(1.0, 2.0)) == 0.0
