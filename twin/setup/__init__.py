"""twin.toml made from a folder of recordings: what is found, what its user changes, what is then written.

Read `draft` first: all that twin.toml will be made from, and the steps that change it. `tagroles` tells the
rig's tags from those of the finger, `rigframe` where the rig is, `proposal` puts both into a configuration,
says what is found and what nobody has decided, and writes. `outline` lays the model over the film's first
picture, with handles, and `svglayers` draws that. `desk` is what a page holds: every event gives another one.
`recordedpictures` has what it shows of the recordings. `page` shows a desk in a browser by its `panels` and
decides nothing, `server` serves it.
"""
