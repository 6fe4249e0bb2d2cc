"""What speaks for an effect, written into a run."""

from twin.diagnosis.explanation import Explanation
from twin.project.folder import Run


def write_evidence(run: Run, found: Explanation) -> None:
    """Write evidence.json, and the maps in evidence.npz."""
    run.write_json("evidence.json", found.to_dict())
    run.write_npz("evidence.npz", found.arrays)
