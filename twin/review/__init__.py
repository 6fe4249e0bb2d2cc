"""The recording for rerun: the film beside the simulated finger.

`states` holds what is shown, one state a generation and one a film time; `filmed` the models as the film's
camera would see them. `scene` draws the simulated finger, `filmlayer` the models over the film and the strain
of a speckled face; `arrangement` lays out the views. `recording` writes it all. `finger` records the finger
alone, undeformed with its dimensions or in its predicted shapes.
"""
