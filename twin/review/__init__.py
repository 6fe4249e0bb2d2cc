"""What the runs found becomes things to look at: a rerun recording, a report, pictures, files for ParaView.

`states` holds what is shown; `filmed` the models as the film's camera would see them, whose edges `outlines`
finds. `scene`, `overprint`, `strainlayer`, `arrangement` and `recording` write rerun; `painting` and `clip`
draw over film; `deformed` draws the mesh; `plots` (in the look of `styling`) and `page` make the report.
"""
