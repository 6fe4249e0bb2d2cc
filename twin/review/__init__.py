"""What the runs found becomes things to look at: a rerun recording, a report, pictures, files for ParaView.

`states` holds what is shown; `scene` and `recording` write rerun; `deformed` draws the mesh; `plots` (in
the look of `styling`) and `page` make the report.
"""
