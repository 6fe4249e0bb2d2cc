"""Gathers the pages of the site in a folder: what mkdocs.yml builds. `make docs` runs it.

    python benchmarks/docs/sitepages.py build/docs

The folder mirrors the repository, so that every link of a page stays as it is: README.md, and every page and
picture that it leads to. What is made here is added: a page of the scripts of examples/ with what they print,
a page for each notebook with its output, and the reference of each package's public names.
"""

import argparse
import os
import re
import shutil
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

sys.path.insert(0, os.path.abspath(f"{__file__}/../../.."))
from benchmarks import ROOT
from benchmarks.docs.executed import EXAMPLES, NOTEBOOKS, PACKAGES, page_of

LINK = re.compile(r"\]\(([^)\s#]+)")
WORKERS = 2
BESIDE = {"twin": ("twin.notebook.OpenedProject", "twin.results.StageResult")}  # what a public name returns
BLOCK = """
::: {}
    options:
      show_root_heading: true
"""
STYLE = ".language-text code { white-space: pre-wrap; }\n"  # what a program prints has long lines
GALLERY = """# What can each package do alone?

Each script runs in seconds, `python examples/solve_finger.py`. Here is what it prints.

"""


def written_pages() -> set[Path]:
    """README.md and every file of the repository that it leads to by relative links."""
    seen: set[Path] = set()
    todo = [ROOT / "README.md"]
    while todo:
        page = todo.pop()
        if page in seen or not page.is_file():
            continue
        seen.add(page)
        links = LINK.findall(page.read_text(encoding="utf-8")) if page.suffix == ".md" else []
        todo += [(page.parent / link).resolve() for link in links if "://" not in link]
    return seen


# -- the folder ----------------------------------------------------------------------------------------------


def gathered(folder: Path, ran: Path) -> None:
    """Every page in `folder`, anew; `ran` keeps those of scripts and notebooks from build to build."""
    told = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")  # in whose order the scripts stand
    scripts = sorted(EXAMPLES.glob("*.py"), key=lambda path: told.index(f"`examples/{path.name}`"))
    notebooks = sorted(NOTEBOOKS.glob("*.py"))
    with ThreadPoolExecutor(WORKERS) as pool:
        list(pool.map(lambda path: page_of(path, ran / f"{path.stem}.md"), [*notebooks, *scripts]))
    shutil.rmtree(folder, ignore_errors=True)
    for page in written_pages():
        to = folder / page.relative_to(ROOT)
        to.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(page, to)
    (folder / "site.css").write_text(STYLE, encoding="utf-8")
    (folder / "examples" / "notebooks").mkdir(parents=True)
    (folder / "reference").mkdir()
    sections = [(ran / f"{path.stem}.md").read_text(encoding="utf-8") for path in scripts]
    (folder / "examples" / "README.md").write_text("".join([GALLERY, *sections]), encoding="utf-8")
    for path in notebooks:
        for made in (ran / f"{path.stem}.md", *ran.glob(f"{path.stem}-*.png")):
            shutil.copyfile(made, folder / "examples" / "notebooks" / made.name)
    for name in PACKAGES:
        text = f"# {name}\n\n::: {name}\n" + "".join(map(BLOCK.format, BESIDE.get(name, ())))
        (folder / "reference" / f"{name}.md").write_text(text, encoding="utf-8")


def main() -> None:
    arguments = argparse.ArgumentParser(description="Gather the pages of the site.")
    arguments.add_argument("folder", type=Path, help="where to; what is there is replaced")
    folder = arguments.parse_args().folder
    gathered(folder, folder.with_name(f"{folder.name}-ran"))


if __name__ == "__main__":
    main()
