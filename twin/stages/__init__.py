"""The stages of `twin`, one file each, named as what one does: calibrating, comparing, diagnosing.

Begin with `chain`, the one list of stages with what each reads and writes. `workbench` is what every stage
after `measure` starts from: targets, model, whitener. `fits` says which runs still belong to the project.
"""
