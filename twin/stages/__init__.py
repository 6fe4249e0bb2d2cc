"""The stages of `twin`, one file each, in the order of a project.

`chain` lists them. `workbench` is what every stage after `measure` starts from: targets, model, whitener.
"""
