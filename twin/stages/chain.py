"""The stages after `measure`, in the order in which a project goes through them."""

from twin.stages.adding import run_add, run_drop
from twin.stages.calibrating import run_calibrate
from twin.stages.comparing import run_compare
from twin.stages.diagnosing import run_diagnose
from twin.stages.reviewing import run_review

__all__ = ["run_add", "run_calibrate", "run_compare", "run_diagnose", "run_drop", "run_review"]
