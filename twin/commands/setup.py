"""Write twin.toml from a folder of recordings: films, tags, board, log and clock are found, not typed."""

from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from twin import files
from twin.commands.check import check_project
from twin.commands.init import film_config
from twin.messages import Say
from twin.project.folder import named_after
from twin.setup.draft import draft_of
from twin.setup.proposal import Proposal, proposed, said_of, write_proposal


def run_setup(
    folder: Annotated[Path, Argument(help="folder with film, board pictures and log")],
    say: Say,
    *,
    yes: Annotated[bool, Option("--yes", help="write what is found, without the page")] = False,
    dry_run: Annotated[bool, Option("--dry-run", help="say what is found, and write nothing")] = False,
    port: Annotated[int, Option(help="port of the page on 127.0.0.1; 0: any free one", min=0, max=65535)] = 0,
) -> dict[str, Any]:
    """twin.toml with what a folder of recordings shows: in a browser, to be corrected by clicks; or as it is
    found. A former one keeps its [model] and all that no recording tells, and is kept as twin-0001.toml."""
    root = folder.resolve()
    if not root.is_dir():
        raise ValueError(f"{folder}: no such folder; wanted the one with the recordings")
    say.progress("looking at the recordings", 0, 1)
    proposal = proposed(draft_of(root, film_config(named_after(root))))
    wanted = _told(proposal, say, written=yes)
    result: dict[str, Any] = {"stage": "setup", "status": "done", "project": str(folder), "wanted": wanted}
    if yes:
        write_proposal(proposal, say)
        say(f"Wrote {folder / 'twin.toml'}. Next: `twin check --project {files.typed(folder)}`.")
    elif dry_run:
        say("Nothing is written: add --yes, or leave --dry-run out for a page in the browser.")
    elif find_spec("nicegui") is None:
        say("Nothing is written: add --yes. For a page to correct it in: pip install nicegui.")
    elif proposal.draft.found.film is None:
        raise ValueError(f"there is nothing to show: {' '.join(proposal.draft.found.missing)}")
    else:
        from twin.setup.server import serve

        result["written"] = serve(proposal.draft, say, check=check_project, port=port)
    return result


def _told(proposal: Proposal, say: Say, *, written: bool) -> list[str]:
    """What is not decided, after all of what is found is said."""
    for line in said_of(proposal):
        say(line)
    wanted = proposal.wanted
    if wanted:
        say("Not decided; correct it in twin.toml:" if written else "Not decided:")
    for line in wanted:
        say(f"  {line}")
    return wanted
