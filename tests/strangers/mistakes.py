"""Mistakes of strangers in a small drawn project, each one thing of it changed.

`MISTAKES` must be refused, by a sentence that names the thing; `RIGHT` are unusual and right, and must pass.
`recordings` has more of both.
"""

import numpy as np

from tests.strangers.planting import (
    Plant,
    bad_log,
    blur,
    camera_with,
    commas,
    creeping,
    cut_static,
    early,
    every,
    exchanged,
    filmed,
    flat_log,
    from_behind,
    hidden,
    ids,
    interlaced,
    lens_of,
    littered,
    log,
    marker,
    no_boards,
    nudged,
    on_its_side,
    painted,
    raw_stream,
    regulated,
    sagging,
    small_film,
    swinging,
    toml,
    twice,
)  # fmt: skip
from tests.strangers.studio import FILM_START, LOG_END, STILL, Y, motion
from twin import files

# What is planted, and what the sentence has to say.
MISTAKES: dict[str, tuple[Plant, str]] = {
    "positions in cm": (every(place=lambda at: [v / 10 for v in at]), r"positions in cm instead of mm"),
    "positions of the rig in cm": (
        every(finger=False, place=lambda at: [v / 10 for v in at]), r"positions in cm instead of mm"
    ),
    "positions of the rig in inches": (
        every(finger=False, place=lambda at: [v / 25.4 for v in at]), r"positions in inches"
    ),
    "positions of the finger in cm": (
        every(rig=False, place=lambda at: [v / 10 for v in at]),
        r"not on the finger|lies .* mm from its stated place",
    ),
    "all sizes twice": (every(size=2.0), r"size_mm says 18 mm, which is 2\.\d+ times as much"),
    "all sizes in cm": (every(size=0.1), r"sizes in cm instead of mm"),
    "sizes with the white border": (every(size=8 / 6), r"1\.3\d times as much.*without its white border"),
    "one size twice": (
        toml(marker("frame2", size_mm=18.0)), r"'frame2' has size_mm = 18, but looks (8\.[89]|9)"
    ),
    "two frame ids exchanged": (
        exchanged("frame0", "frame3"), r"'frame0' \(id 3\) and 'frame3' \(id 0\) have each other's places"
    ),
    "a frame and a fixed id exchanged": (
        exchanged("frame1", "fixed9"), r"'frame1' \(id 9\) and 'fixed9' \(id 1\) have each other's places"
    ),
    "a frame marker 18 mm off": (
        toml(marker("frame1", position_mm=(48.0, Y, 30.0))),
        r"'frame1' lies 1[78].\d mm from its stated place.*see it at x = 30.\d, z = (29|30).\d mm",
    ),
    "a sign of a frame marker": (
        toml(marker("frame4", position_mm=(24.0, Y, -58.0))),
        r"'frame4' lies 4[5-9].\d mm from its stated place",
    ),
    "a finger's id exchanged with a frame marker's": (
        exchanged("frame2", "tip"), r"'frame2' \(id 23\) and 'tip' \(id 2\) have each other's places"
    ),
    "z mirrored": (
        every(place=lambda at: (at[0], at[1], -at[2])), r"positions are mirrored.*their z runs down"
    ),
    "x of the rig mirrored": (
        every(finger=False, place=lambda at: (-at[0], at[1], at[2])), r"positions are mirrored"
    ),
    "y of the wrong sign": (every(place=lambda at: (at[0], -at[1], at[2])), r"positions are mirrored"),
    "tip and middle exchanged": (
        exchanged("tip", "middle"), r"'middle' \(id 23\) and 'tip' \(id 22\) lie in the opposite order"
    ),
    "neighbours on the finger exchanged": (
        exchanged("p2", "middle"), r"'p2' \(id 22\) and 'middle' \(id 21\) lie in the opposite order"
    ),
    "finger counted from the tip": (
        every(rig=False, place=lambda at: (110.0 - at[0], at[1], at[2])), r"reverse of the stated order"
    ),
    "origin of the rig 60 mm off": (
        every(finger=False, place=lambda at: (at[0] + 60, at[1], at[2])), r"mm from its stated place at rest"
    ),
    "a finger id that never appears": (
        toml(marker("tip", marker=33)), r"'tip' \(id 33\).*of no stated marker, are the ids 23"
    ),
    "all ids one too large": (ids(1), r"all ids of twin.toml are 1 too large: lower every marker = \.\.\. by 1"),
    "a mirrored film": (painted(lambda _, grey: grey[:, ::-1]), r"it is mirrored; set mirrored = true"),
    "films on their side": (on_its_side, r"400 x 640 px.* 640 x 400: one of them lies on its side"),
    "an interlaced film": (interlaced, r"film\.mkv is interlaced: in \d+ of the \d+ frames looked at"),
    "another dictionary": (camera_with(dictionary="DICT_6X6_50"), r"DICT_4X4_50 finds"),
    "film starts in motion": (filmed(early), r"film.mkv: the finger is not at rest between 0.00 and 1.80 s"),
    "static film in motion": (
        filmed(swinging, name="static.mkv", frames=STILL), r"static.mkv: the finger is not at rest"
    ),
    "static film too short": (cut_static, r"static.mkv has 60 frames, wanted at least 120"),
    "dark film": (painted(lambda _, grey: grey / 12), r"the picture is dark"),
    "blurred film": (painted(blur(5.0)), r"the picture is blurred"),
    "frame markers covered": (
        painted(hidden("frame0", "frame1", "frame2", "frame3")), r"shows 3 of 7 frame markers"
    ),
    "finger's markers lost": (
        painted(hidden("root", "p2", "middle", "tip", since=20), "film.mkv"),
        r"of the .* frames looked at show a marker of the finger",
    ),
    "film of another size": (
        small_film, r"film.mkv has 320 x 200 px, the camera was calibrated with 640 x 400"
    ),
    "film of a finger at rest": (
        filmed(lambda marks, time: motion(marks, 0 * time)), r"the finger does not move"
    ),
    "film that is none": (
        lambda root: files.write_text(root / "raw" / "film.mkv", "no film"), r"cannot be read as a video"
    ),
    "a lens of another model": (lens_of("equidistant"), r"lens model distortion_model = 'equidistant': wanted Brown's"),
    "a film without a container": (raw_stream, r"film\.h264 holds no time stamps"),
    "boards not in the pictures": (no_boards, r"0 of 9 board images show"),
    "kPa for MPa": (log(factor=1e3), r"wanted 0\.0001 to 1 MPa"),
    "psi for MPa": (log(factor=145.04), r"wanted 0\.0001 to 1 MPa"),
    "MPa under kPa": (log(head="time_s,pressure_kPa"), r"wanted 0.0001 to 1 MPa"),
    "decimal commas": (bad_log(commas()), r"decimal commas"),
    "mbar under kPa, with the regulator's pressure": (
        regulated(30.0, head="time_s,pressure_kPa", factor=1e4), r"likely in mbar"
    ),
    "log shorter than the film": (
        log(time=np.arange(0.0, 17.0, 0.02)), r"the film 14.000 to 18.500 s of the same clock"
    ),
    "log on another clock": (camera_with(film_start_s=FILM_START - 5.0), r"correct film_start_s"),
    "log of a shifted test": (log(shift=4.0), r"correct film_start_s"),
    "log of another day": (bad_log(flat_log()), r"explains \d+ % of the motion, wanted 30 %"),
    "time in ms": (log(time=np.arange(0.0, LOG_END * 1e3, 20.0)), r"20 s apart, so its time is likely in ms"),
    "absolute pressure": (log(head="time_s,p [bar(a)]"), r"absolute pressure"),
    "pressure without a unit": (log(head="time_s,pressure"), r"has no unit"),
}  # fmt: skip

# Unusual and right.
RIGHT: dict[str, Plant] = {
    "nothing planted": lambda root: None,
    "what systems leave beside the boards": littered,
    "a marker of the same id elsewhere": painted(twice),  # the one in its stated place is followed
    "sizes 10 % off": every(size=1.1),
    "a frame marker 2 mm off": toml(marker("frame1", position_mm=(32.0, Y, 30.0))),
    "frame positions by a ruler": toml(nudged(0.5)),
    "camera on the -y side": from_behind,
    "a sag of 25 mm at rest": sagging(25.0),
    "a drift of 0.1 mm in the reference": filmed(creeping(-0.1)),
    "clock 1.5 s off": camera_with(film_start_s=FILM_START + 1.5),
    "a finger that moves by half a millimetre": filmed(
        lambda marks, time: motion(marks, 0 * time) + 0.05 * (motion(marks, time) - motion(marks, 0 * time))
    ),
    "a frame marker covered": painted(hidden("frame5")),
    "a soft focus": painted(blur(1.5)),
    "little light": painted(lambda _, grey: 16 + grey / 4),
    "pressure in kPa": log(factor=1e3, head="t [s],p [kPa]"),
    "pressure in psi": log(factor=145.04, head="time_s,Pressure (psi)"),
    "the regulator's pressure": regulated(25.0, factor=1.0),
    "the tip hidden for a while": painted(
        lambda i, grey: hidden("tip")(i, grey) if 25 <= i < 33 else grey, "film.mkv"
    ),
}  # fmt: skip
