"""A folder from a stranger: its programs do not run and its links are not followed before `twin trust`."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.messages import run, saying, says
from tests.strangers.received import with_path
from twin import cli, files
from twin.batches.former import former_of
from twin.bench.effectlaws import named_effect
from twin.bench.fits import changes
from twin.bench.workbench import own_of
from twin.project import trust
from twin.project.cameratables import CameraTable
from twin.project.config import Config
from twin.project.folder import Project
from vision.film.series import TIMES

TOML = '[[points]]\nname = "tip"\nnode = 4401\n[calibrate]\nobjective_points = ["tip"]\n'
PROGRAM = "from pathlib import Path\nPath({ran!r}).touch()\nfrom twin import Effect\nclass Fan(Effect):\n    name = 'fan'\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "settings"))
    (tmp_path / "batch").mkdir()
    (tmp_path / "batch" / "twin.toml").write_text(TOML)
    return tmp_path / "batch"


def with_program(folder: Path) -> Path:
    """The file that the project's effect makes when it runs."""
    ran = folder.parent / "ran"
    (folder / "effects").mkdir()
    (folder / "effects" / "fan.py").write_text(PROGRAM.format(ran=str(ran)))
    (folder / "twin.toml").write_text(TOML + '[model]\neffect_files = ["effects/fan.py"]\n')
    return ran


def test_a_program_runs_only_once_it_is_trusted(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ran = with_program(folder)
    told = r"effects/fan.py is a program of 5 lines that would run .* `twin trust -p .*batch`"
    with pytest.raises(ValueError, match=told):
        own_of(Project.open(folder))
    assert not ran.exists()
    run("trust", "-p", folder)
    says(capsys.readouterr().out, "effects/fan.py", "5")
    assert [e.name for e in own_of(Project.open(folder))] == ["fan"]
    assert ran.exists()


def test_a_program_that_was_changed_is_trusted_no_more(folder: Path) -> None:
    with_program(folder)
    run("trust", "-p", folder)
    own_of(Project.open(folder))
    path = folder / "effects" / "fan.py"
    path.write_text(path.read_text() + "# more\n")
    with pytest.raises(ValueError, match="has not been trusted"):
        own_of(Project.open(folder))


def test_the_folder_cannot_trust_itself(folder: Path) -> None:
    ran = with_program(folder)
    (program,) = trust.programs(folder, ["effects/fan.py"])
    for place in (folder / "trusted.json", folder / "softtwin" / "trusted.json"):
        place.parent.mkdir(exist_ok=True)
        place.write_text(f'{{"{program.digest}": "mine"}}')
    with pytest.raises(ValueError, match="has not been trusted"):
        own_of(Project.open(folder))
    assert not ran.exists()


def test_a_program_that_is_a_link_out_of_the_folder_never_runs(folder: Path) -> None:
    ran = with_program(folder)
    (folder / "effects" / "fan.py").rename(folder.parent / "fan.py")
    (folder / "effects" / "fan.py").symlink_to(folder.parent / "fan.py")
    for work in (lambda: Project.open(folder), lambda: run("trust", "-p", folder)):  # no dead end: both say the way out
        with pytest.raises(ValueError, match=saying("effects/fan.py", "fan.py")):
            work()
    assert trust.trusted() == {}
    assert not ran.exists()


def test_a_file_named_on_the_command_line_is_trusted(folder: Path) -> None:
    ran = with_program(folder)
    project = Project.open(folder)
    with pytest.raises(ValueError, match=saying("other.py", "effects/fan.py")):
        named_effect(project, "other.py")
    assert not ran.exists()
    assert named_effect(project, "creep") == "creep"
    assert not ran.exists()
    assert named_effect(project, "effects/fan.py") == "fan"
    assert ran.exists()
    assert [e.name for e in own_of(project)] == ["fan"]


@pytest.mark.parametrize("name", ["runs", "cache", "targets", "targets/targets.csv", "runs/0001-calibrate"])
def test_links_where_commands_write_or_read_text_are_refused(folder: Path, name: str) -> None:
    outside = folder.parent / "outside"
    outside.mkdir()
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / name).symlink_to(outside)
    with pytest.raises(ValueError, match=rf"{name} is a link: wanted"):
        Project.open(folder)
    assert not list(outside.iterdir())


@pytest.mark.parametrize("name", ["../secret.csv", "raw/../../secret.csv", "..\\\\secret.csv"])
def test_paths_out_of_the_folder_are_refused(folder: Path, name: str) -> None:
    (folder / "twin.toml").write_text(TOML + f'[pressure]\nfile = "{name}"\n')
    with pytest.raises(ValueError, match=r"wanted a path inside the project folder, without \.\."):
        Project.open(folder)


def test_a_link_of_twin_toml_is_followed_once_it_is_trusted(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "raw").mkdir()
    (folder.parent / "secret.csv").write_text("a word that nobody may see\n")
    (folder / "raw" / "pressure.csv").symlink_to(folder.parent / "secret.csv")
    (folder / "twin.toml").write_text(TOML + '[pressure]\nfile = "raw/pressure.csv"\n')
    with pytest.raises(ValueError, match=saying("raw/pressure.csv", "secret.csv")) as told:
        Project.open(folder)
    assert "nobody" not in str(told.value)
    run("trust", "-p", folder)
    assert "raw/pressure.csv: a link to" in capsys.readouterr().out
    Project.open(folder)
    (folder / "raw" / "pressure.csv").unlink()
    (folder / "raw" / "pressure.csv").symlink_to(folder.parent)  # elsewhere: not what was trusted
    with pytest.raises(ValueError, match="outside the project folder"):
        Project.open(folder)


def test_a_linked_folder_of_raw_files_is_seen(folder: Path) -> None:
    (folder.parent / "elsewhere").mkdir()
    (folder.parent / "elsewhere" / "pressure.csv").write_text("x\n")
    (folder / "raw").symlink_to(folder.parent / "elsewhere")
    (folder / "twin.toml").write_text(TOML + '[pressure]\nfile = "raw/pressure.csv"\n')
    with pytest.raises(ValueError, match="outside the project folder"):
        Project.open(folder)


def film(folder: Path) -> str:
    return '[[cameras]]\nname = "a"\nfilm = "raw/film"\nstatic = "raw/still"\ncamera_file = "raw/c.yml"\n'


NAMED = {  # keys that name files, each with a link at that place
    "raw/second.mp4": '[[films]]\nname = "1"\nfile = "raw/film"\n[[films]]\nname = "2"\nfile = "raw/second.mp4"\n',
    "raw/second.csv": '[[films]]\nname = "1"\nfile = "raw/film"\n[[films]]\nname = "2"\nfile = "raw/b"\npressure = "raw/second.csv"\n',
    "raw/film/1.png": "",
    "raw/mended.csv": '[measure]\ncorrections = "raw/mended.csv"\n',
    "raw/dice/DICe_solution_1.txt": '[import]\nfile = "raw/dice"\nformat = "dice"\n',
}


@pytest.mark.parametrize("name", NAMED)
def test_every_path_of_twin_toml_is_looked_at(folder: Path, name: str) -> None:
    (folder.parent / "secret.csv").write_text("x\n")
    (folder / name).parent.mkdir(parents=True)
    (folder / name).symlink_to(folder.parent / "secret.csv")
    (folder / "raw" / "film").mkdir(exist_ok=True)
    with_film = not NAMED[name].startswith(("[measure]", "[import]"))
    frame = "".join(
        f'[[frame.markers]]\nname = "f{k}"\nsize_mm = 8.0\nrole = "{"frame" if k < 6 else "fixed"}"\nposition_mm = [{k}.0, 0.0, 0.0]\n'
        for k in range(10)
    )
    text = TOML.replace("node = 4401", "node = 4401\nsize_mm = 6.0") + NAMED[name]
    text += film(folder) + frame + '[pressure]\nfile = "raw/p.csv"\n' if with_film else ""
    (folder / "twin.toml").write_text(text)
    with pytest.raises(ValueError, match=rf"{name} is a link to .*secret.csv, outside the project folder"):
        Project.open(folder)


def test_every_key_that_names_a_file_is_looked_at(folder: Path) -> None:
    (folder / "raw").mkdir()
    (folder / "raw" / "link").symlink_to(folder.parent / "secret")
    every = with_path(Config, "raw/link")
    assert len(every) >= 16
    for config in every:
        assert [one.name for one in trust.links(folder, config)] == ["raw/link"], config


def test_what_lies_behind_a_link_is_not_even_listed(folder: Path) -> None:
    (folder / "raw").mkdir()
    (folder / "raw" / "film").symlink_to(folder.parent)
    (folder.parent / "private").symlink_to("secret")
    config = Config.model_construct(cameras=(CameraTable.model_construct(film="raw/film"),))
    assert [one.name for one in trust.links(folder, config)] == ["raw/film"]


def test_the_times_beside_a_pattern_are_looked_at(folder: Path) -> None:
    assert trust.TIMES == TIMES
    (folder / "raw").mkdir()
    (folder / "raw" / "film-1.png").write_bytes(b"x")
    (folder / "raw" / "times.csv").symlink_to(folder.parent / "secret.csv")
    config = Config.model_construct(cameras=(CameraTable.model_construct(film="raw/film-*.png"),))
    assert [one.name for one in trust.links(folder, config)] == ["raw/times.csv"]


def test_a_former_batch_elsewhere_is_read_once_it_is_trusted(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for other in (folder.parent / "private" / "other", folder.parent / "beside"):
        other.mkdir(parents=True)
        (other / "twin.toml").write_text(TOML)
    (folder / "twin.toml").write_text(TOML + '[project]\nlike = "../beside"\n')
    assert former_of(Project.open(folder)).root == folder.parent / "beside"
    (folder / "twin.toml").write_text(TOML + '[project]\nlike = "../private/other"\n')
    with pytest.raises(ValueError, match=saying(r"\.\./private/other", "private/other")):
        Project.open(folder)
    run("trust", "-p", folder)
    assert "../private/other: the former batch in" in capsys.readouterr().out
    assert former_of(Project.open(folder)).root == folder.parent / "private" / "other"


def test_a_former_batch_that_init_is_told_is_trusted(folder: Path) -> None:
    run("init", folder.parent / "elsewhere" / "new", "--like", folder)
    assert Project.open(folder.parent / "elsewhere" / "new").config.project.like == "../../batch"


def test_a_run_that_the_folder_names_is_a_run_of_its_own(folder: Path) -> None:
    (folder / "targets").mkdir()
    (folder.parent / "0001-secret").mkdir()
    for told in ("../../0001-secret", "..", str(folder.parent / "0001-secret")):
        (folder / "targets" / "source.json").write_text(json.dumps({"run": told}))
        with pytest.raises(ValueError, match=r"source\.json: run = "):
            Project.open(folder).source()


def test_a_file_that_a_run_has_recorded_is_not_read_outside(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    project, secret = Project.open(folder), folder.parent / "secret.csv"
    secret.write_text("x\n")
    with project.new_run("compare", inputs=[]) as made:
        pass
    record = project.info(made.folder)
    files.write_json(made.path("run.json"), record.model_copy(update={"inputs": {"../secret.csv": files.digest_of([secret], root=folder)["secret.csv"]}}))
    assert changes(project, made.folder, tables=(), present=()) == ["../secret.csv is gone"]


def test_a_link_within_the_folder_is_no_fault(folder: Path) -> None:
    (folder / "raw").mkdir()
    (folder / "raw" / "own.csv").write_text("x\n")
    (folder / "raw" / "pressure.csv").symlink_to("own.csv")
    (folder / "twin.toml").write_text(TOML + '[pressure]\nfile = "raw/pressure.csv"\n')
    project = Project.open(folder)
    assert (project.root / project.config.pressure.file).read_text() == "x\n"


def test_a_twin_toml_that_is_a_link_is_refused(folder: Path) -> None:
    (folder / "twin.toml").rename(folder.parent / "twin.toml")
    (folder / "twin.toml").symlink_to(folder.parent / "twin.toml")
    with pytest.raises(ValueError, match="is a link out of its folder"):
        Project.open(folder)


@pytest.mark.parametrize("helper", ["effects/helper.py", "effects/helper/__init__.py", "helper.py", "effects/deeper.py"])
def test_what_a_program_imports_from_the_folder_is_trusted_with_it(folder: Path, helper: str) -> None:
    with_program(folder)
    for name in ("effects/helper.py", helper):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text("from deeper import SIZE\n")
    if helper != "effects/deeper.py":
        (folder / "effects" / "deeper.py").write_text("SIZE = 1\n")
    path = folder / "effects" / "fan.py"
    path.write_text(path.read_text() + "    def size(self):\n        import helper\n        return helper.SIZE\n")
    (folder / "effects" / "notes.py").write_text("nobody imports it\n")
    run("trust", "-p", folder)
    own_of(Project.open(folder))
    assert {"effects/fan.py", helper} <= {*map(Project.open(folder).shown, Project.open(folder).effect_files())}
    (folder / "effects" / "notes.py").write_text("still nobody\n")
    own_of(Project.open(folder))
    (folder / helper).write_text("SIZE = 2\n")
    with pytest.raises(ValueError, match=saying("effects/fan.py", "imports", helper, "twin trust")):
        own_of(Project.open(folder))


def test_a_trusted_program_that_has_run_is_still_trusted(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Python would write __pycache__ into the package that it imports."""
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    monkeypatch.syspath_prepend(folder / "effects")
    with_program(folder)
    (folder / "effects" / "fanparts").mkdir()
    (folder / "effects" / "fanparts" / "__init__.py").write_text("SIZE = 1\n")
    path = folder / "effects" / "fan.py"
    path.write_text(path.read_text() + "import fanparts\n")
    run("trust", "-p", folder)
    before = Project.open(folder).effect_files()
    own_of(Project.open(folder))
    assert "fanparts" in sys.modules
    own_of(Project.open(folder))
    assert Project.open(folder).effect_files() == before


WORKERS = """
from twin.executors.local import Processes
from twin.drawing.deformed import can_draw
if __name__ == "__main__":
    print(sorted(Processes(2).ended([int, int])), can_draw())
"""
COMMAND = "import sys; sys.path.append(''); sys.argv = ['twin', 'list']; from twin.main import start; start()"


@pytest.mark.parametrize("path", [None, "", ":", ".:", "sub:"])
def test_nothing_that_lies_in_the_current_folder_runs(folder: Path, path: str | None) -> None:
    """Neither in the command itself, nor in the drawing's trial or in workers, which `python -c` would let."""
    for parent in (folder, folder / "sub"):
        parent.mkdir(exist_ok=True)
        for name in ("vtkmodules", "numpy", "multiprocessing"):
            (parent / f"{name}.py").write_text(f"open({str(folder.parent / 'ran')!r}, 'a').write({name!r})\n")
    script = folder.parent / "workers.py"
    script.write_text(WORKERS)  # as from a notebook, without the command
    line, wanted = ([script], "[(0, 0), (1, 0)]") if path is None else (["-P", "-c", COMMAND], "no runs yet")
    env = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONSAFEPATH")}
    env |= {} if path is None else {"PYTHONPATH": path}
    done = subprocess.run([sys.executable, *line], cwd=folder, env=env, capture_output=True, text=True, timeout=120)
    assert done.stdout.startswith(wanted), done.stderr
    assert not (folder.parent / "ran").exists()


@pytest.mark.parametrize("name", [".numba_config.yaml", "matplotlibrc"])
def test_settings_of_libraries_in_the_current_folder_are_refused(
    folder: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """numba unpickles what lies in the cache folder that its settings name."""
    (folder / name).write_text("")
    monkeypatch.chdir(folder)
    with pytest.raises(ValueError, match=saying(name, "remove it", "--project")):
        cli._parse(["list"])
