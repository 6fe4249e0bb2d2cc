"""Priors and the loss that twin.toml states: what is refused, and which stages refuse them."""

import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from tests.messages import Lines, saying
from twin.bench.priors import TAILS, known_values
from twin.bench.workbench import own_of
from twin.commands.calibrate import run_calibrate
from twin.commands.diagnose import run_diagnose
from twin.commands.explain import run_explain
from twin.commands.posterior import run_posterior
from twin.commands.recalibrate import _undiagnosed
from twin.laws.mooneyrivlin import MOONEY_RIVLIN
from twin.project.folder import Project, dataset
from twin.project.toml import dump, parse
from twin.targets import KnownValue


def project(text: str) -> Project:
    """The study with more lines at the end of a table, `model` or `calibrate`, of its twin.toml."""
    whole = (dataset("study") / "twin.toml").read_text()
    for line in text.splitlines():
        key = line.partition(" =")[0]
        was = next(row for row in whole.splitlines() if row.startswith(f"{key} ="))
        whole = whole.replace(was, line)
    return replace(Project.open(dataset("study")), config=parse(whole.encode(), name="twin.toml"))


def test_priors_of_constants_combinations_and_absent_effects_are_read() -> None:
    found = project('priors = {C10 = [0.2, 0.05], "C10+C01" = [0.3, 0.02], share = [0.2, 0.1], "creep.g1" = [0.1, 0.02]}')
    known = known_values(found, MOONEY_RIVLIN, own_of)
    assert known[0] == KnownValue(name="C10", mean=0.2, sd=0.05)
    assert [one.name for one in known] == ["C10", "C10+C01", "share", "creep.g1"]
    assert tomllib.loads(dump(found.config))["calibrate"]["priors"]["C10+C01"] == [0.3, 0.02]
    assert known_values(project("priors = {}"), MOONEY_RIVLIN, own_of) == ()


@pytest.mark.parametrize(("text", "said"), [
    ('priors = {C20 = [0.2, 0.05]}', r"calibrate.priors.C20: wanted C10, C01, C10\+C01, share, or a parameter of an effect"),
    ('priors = {"crep.g1" = [0.2, 0.05]}', r"calibrate.priors.crep.g1: wanted C10, .* correct the name"),
    ('effects = ["creep"]\npriors = {"creep.h1" = [0.2, 0.05]}', r"calibrate.priors.creep.h1: creep has creep.g1, creep.tau1; correct"),
    ('fixed = {C10 = 0.2}\npriors = {"C10+C01" = [0.3, 0.05]}', r"C10 = 0.2 MPa is held under \[model\] fixed; remove one of them"),
    ('priors = {C10 = [200.0, 50.0]}', r"calibrate.priors.C10 = \[200, 50\]: wanted mean and sd in MPa.* are they in kPa\?"),
    ('priors = {share = [30.0, 5.0]}', r"calibrate.priors.share = \[30, 5\]: wanted C01 / \(C10 \+ C01\), from 0 to 1"),
    ('priors = {C10 = [0.2, 0.0]}', r"priors\.C10.*greater than 0|priors\.C10.*above 0"),
    ('loss = "huber"', r"calibrate.loss = 'huber'"),
])  # fmt: skip
def test_what_is_known_of_nothing_is_refused(text: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        known_values(project(text), MOONEY_RIVLIN, own_of)


def test_stages_that_count_every_value_in_full_refuse_weights() -> None:
    found, say = project('loss = "student-t"'), Lines()
    assert TAILS[found.config.calibrate.loss] == 4.0
    for run in (run_diagnose, run_posterior):
        with pytest.raises(ValueError, match=saying("calibrate.loss = 'student-t'", "down_weighted")):
            run(found, say)
    with pytest.raises(ValueError, match=saying("calibrate.loss = 'student-t'", "twin explain")):
        run_explain(found, say, name="creep")
    assert _undiagnosed(found) == "loss = 'student-t'"
    assert _undiagnosed(project("priors = {}")) == "no noise model"


@pytest.mark.parametrize("starts", [1, 1001, -3])
def test_a_number_of_starts_that_shows_nothing_is_refused(starts: int, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=rf"--starts {starts}: wanted 2 to 1000 starts, such as 10"):
        run_calibrate(project("priors = {}"), Lines(), starts=starts)
