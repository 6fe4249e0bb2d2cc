"""Grey frames of a film file with the container's own time stamps, one frame in memory at a time."""

import os
import sys
from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import Any

import av
import numpy as np
from av.container import InputContainer
from av.packet import Packet
from av.stream import Disposition
from av.video.frame import VideoFrame
from numpy.typing import NDArray

from vision.camera import Array, Image
from vision.film.packets import MOST_B, SAME_BITS, Coding, is_simple, longest_between

HALF_TICK = 1e-6  # s, below every time base
TRIED = 64  # first frames that are decoded to see what the time stamps are
# x264 cuts each picture into one slice a thread, which changes the coded picture: the number is part of the
# result, and not that of the machine's CPUs. Decoders conceal damage differently with every number.
CODING_THREADS, DECODING_THREADS = 2, 1
WHOLE = "Film whole pictures (25p, not 50i), or make two of each frame (FFmpeg's filter bwdif)"
# Kinds of files that hold the film themselves. A playlist would make FFmpeg read other files, from anywhere.
CONTAINERS = (
    "mov,matroska,avi,mpegts,mpeg,asf,flv,ogg,mxf,dv,nut,ivf,gif,mjpeg,m4v,h264,hevc,av1,obu,yuv4mpegpipe"
)
RAW = ("h264", "hevc", "vvc", "m4v", "mjpeg", "mpegvideo", "av1", "obu", "h263", "dirac")  # no time stamps
_PLANAR = ("yuv420p", "yuvj420p", "yuv422p", "yuvj422p", "yuv444p", "yuvj444p", "nv12", "gray")


class Video:
    """A film file: its size, its time stamps in s, what is wrong with them, and its frames one by one.

    path: film in any container and codec that FFmpeg reads.   mirrored: frames are given left for right.

    `time` (t,) s is sorted; `issues` holds one sentence each about gaps, duplicates and time stamps that
    run backwards. Frames are turned as the container asks (phones film on their side), like OpenCV turns
    pictures. Raises ValueError when the file is missing, is not a video, or holds no frame.
    """

    _in_order = False  # whether the frames' own stamps are of no use, only their order
    _stream = 0  # which of the file's videos
    _before: int | None = None  # stamp of the first frame that can be decoded, where others stand before it
    _undecoded = ""  # sentence on those

    def __init__(self, path: Path | str, *, mirrored: bool = False) -> None:
        self.path, self.mirrored = Path(path), mirrored
        if not self.path.is_file():
            raise ValueError(f"film {self.path} does not exist: give the path of a video file")
        if self.path.suffix.lower() in (".tif", ".tiff"):
            raise ValueError(
                f"film {self.path} is a TIFF: wanted a video file, or a folder of pictures, one in a file; "
                "split a stack, with times.csv or fps"
            )
        try:
            self._stream, streams = film_stream(self.path)
            frame, stamps, backwards = self._scan()
        except (av.error.FFmpegError, IndexError) as error:
            raise ValueError(
                f"film {self.path} cannot be read as a video ({error}): "
                "give one file that holds the film and that FFmpeg can play, for example mp4 or mkv"
            ) from error
        self.turns = round(frame.rotation / 90) % 4  # quarter turns to the left
        size = (frame.height, frame.width)
        self.height, self.width = size if self.turns % 2 == 0 else size[::-1]
        self.time: Array = np.sort(stamps)
        self._in_order = backwards > 0
        issues = stamp_issues(self.path.name, self.time, backwards, 90 * self.turns)
        self.issues: tuple[str, ...] = (*issues, *_interlaced(self.path.name, frame))
        self.issues += tuple(filter(None, (self._undecoded, _several(self.path.name, streams, size))))

    def _scan(self) -> tuple[VideoFrame, Array, int]:
        """First frame, time stamps (t,) s of all frames, number of them that run backwards."""
        frame = next(self._decoded(), None)
        with opened(self.path) as container:
            stream = container.streams.video[self._stream]
            reorders = bool(stream.codec_context.has_b_frames)
            base = float(stream.time_base or 0)
            packets = [p.pts for p in self._packets(container) if p.pts is not None and not p.is_discard]
            raw = container.format.name in RAW
        if frame is None or not (packets or raw):
            raise ValueError(f"film {self.path} holds no frame that can be decoded: record or copy it again")
        if raw:
            raise ValueError(
                f"film {self.path} holds no time stamps, as a raw stream of the coder has none: wanted the "
                f"time of each frame; copy it into a container with its frame rate (`ffmpeg -framerate 30 -i "
                f"{self.path.name} -c copy {self.path.stem}.mp4`), or give its pictures with times.csv"
            )
        stamps = np.asarray(packets, dtype=np.float64)
        if frame.pts is not None and (before := stamps < frame.pts).any():  # begins amid a group of pictures
            self._before = int(frame.pts)
            self._undecoded = (
                f"{self.path.name} begins within a group of pictures: its first {int(before.sum())} frames "
                f"cannot be decoded and are left out. Its first frame is the one shown "
                f"{(frame.pts - stamps.min()) * base:.3f} s later: film_start_s is the time of that one."
            )
            stamps = stamps[~before]
        # Where frames refer to later ones, some containers (AVI, some MP4) hold decoding times in place of
        # display times. The decoder's order is then the right one; only decoding shows what it is.
        backwards = 0
        if reorders and not self._tells_display_times(stamps):
            stamps = np.array([f.pts for f in self._decoded() if f.pts is not None], dtype=np.float64)
            backwards = int(np.sum(np.diff(stamps) < 0))
        return frame, stamps * base, backwards

    def _tells_display_times(self, stamps: Array) -> bool:
        """True if packets' times (t,) are those at which frames are shown: they do not increase in the file's
        order, but do in the decoder's, as the film's first frames tell."""
        if not np.any(np.diff(stamps) < 0):
            return False
        display = [f.pts for f in islice(self._decoded(), TRIED) if f.pts is not None]
        return len(display) > 1 and bool(np.all(np.diff(display) > 0))

    def _decoded(self, after: float | None = None) -> Iterator[VideoFrame]:
        """Frames in the order they are shown; a packet that cannot be decoded is passed over.

        after: s; only frames from the last key frame before it are decoded.
        """
        with opened(self.path) as container:
            stream = container.streams.video[self._stream]
            stream.codec_context.thread_count = DECODING_THREADS
            if after is not None and stream.time_base:
                container.seek(int(after / float(stream.time_base)), stream=stream)
            for packet in self._packets(container):
                try:
                    yield from packet.decode()
                except av.error.InvalidDataError:
                    continue

    def _packets(self, container: InputContainer) -> Iterator[Packet]:
        """Packets of the film; a file that was cut off ends where it was cut."""
        packets = container.demux(container.streams.video[self._stream])
        while True:
            try:
                yield next(packets)
            except StopIteration:
                return
            except (av.error.InvalidDataError, av.error.EOFError):
                return

    def frames(self, first: int = 0, stop: int | None = None) -> Iterator[tuple[int, float, Image]]:
        """Frames in the order they are shown: (index into `time`, time s, grey levels (h,w)).

        first, stop: indices into `time` of the first frame and of one past the last; by default all. What
        stands before the last key frame in front of `first` is not decoded.

        A frame that cannot be decoded is left out. Where time stamps run backwards, the i-th frame shown
        takes the i-th of them in order. Only one frame is held in memory.
        """
        index, stop = -1, len(self.time) if stop is None else min(stop, len(self.time))
        # Containers find key frames by their decoding times, which run ahead by the B-frames.
        after = float(self.time[first - MOST_B]) if first > MOST_B and not self._in_order else None
        for frame in self._decoded(after):
            index += 1
            if not self._in_order and frame.pts is not None:
                stamp = float(frame.pts * (frame.time_base or 0))
                index = max(index, int(np.searchsorted(self.time, stamp - HALF_TICK)))
            if index >= stop:
                return
            if first <= index < len(self.time):
                picture = np.rot90(_luma(frame), self.turns)
                picture = picture[:, ::-1] if self.mirrored else picture
                yield index, float(self.time[index]), np.ascontiguousarray(picture)

    def chosen(self, indices: Sequence[int]) -> Iterator[tuple[int, float, Image]]:
        """Those of the frames, indices in order, as `frames` gives them; key frames that none of them needs
        are passed over undecoded."""
        keys = np.empty(0, np.intp) if self._in_order else self.keys()
        key = np.searchsorted(keys, indices, side="right")
        for last in np.unique(key):
            rows = [index for index, before in zip(indices, key, strict=True) if before == last]
            yield from (item for item in self.frames(rows[0], rows[-1] + 1) if item[0] in rows)

    def keys(self) -> NDArray[np.intp]:
        """Indices into `time` of the frames that the codec drew anew, without the frames before them."""
        return np.flatnonzero(self.coding().key)

    def coding(self) -> Coding:
        """Coding of the film, from its packets."""
        with opened(self.path) as container:
            stream = container.streams.video[self._stream]
            name, base = stream.codec_context.name, float(stream.time_base or 0)
            simple = is_simple(name, stream.codec_context.profile)
            packets = [
                (p.pts, p.size, bool(p.is_keyframe)) for p in self._packets(container)
                if p.pts is not None and not p.is_discard and (self._before is None or p.pts >= self._before)
            ]  # fmt: skip
        stamps = [pts for pts, _, _ in packets]
        rows = np.arange(len(packets))
        if not self._in_order:
            rows = np.searchsorted(self.time, np.array(stamps) * base - HALF_TICK)
        size, key = np.zeros(len(self.time), np.intp), np.zeros(len(self.time), bool)
        for index, (_, bytes_, is_key) in zip(np.minimum(rows, len(self.time) - 1), packets, strict=True):
            size[index], key[index] = bytes_, key[index] | is_key
        step = np.diff(self.time)
        fps = 1.0 / float(np.median(step)) if len(step) and np.median(step) > 0 else 25.0
        return Coding(name, size, key, longest_between(stamps), fps, simple=simple)


def opened(film: Path) -> InputContainer:
    """A film file of a kind that holds the film itself."""
    return av.open(str(film), container_options={"format_whitelist": CONTAINERS})


def film_stream(path: Path) -> tuple[int, int]:
    """Number of the video stream to read, the largest that is no cover and no still; and how many there are
    besides covers and stills."""
    with opened(path) as container:
        streams = list(container.streams.video)
        if len(streams) == 1:
            return 0, 1
        frames = [0] * len(streams)
        for packet in container.demux(streams):
            frames[[stream.index for stream in streams].index(packet.stream.index)] += packet.pts is not None
            if min(frames) > 1:
                break
        covers = [bool(stream.disposition & Disposition.attached_pic) for stream in streams]
    films = [k for k in range(len(streams)) if frames[k] > 1 and not covers[k]] or list(range(len(streams)))
    return max(films, key=lambda k: (streams[k].width * streams[k].height, -k)), len(films)


def _several(name: str, streams: int, size: tuple[int, int]) -> str:
    """A sentence where a file holds several videos (streams), of which one is read."""
    if streams < 2:
        return ""
    return f"{name} holds {streams} videos: the largest is read, of {size[1]} x {size[0]} px."


def _luma(frame: VideoFrame) -> Image:
    """Grey levels (h,w); the luma plane itself where the format has one, which saves the conversion."""
    if frame.format.name not in _PLANAR:
        return np.ascontiguousarray(frame.to_ndarray(format="gray"))
    plane = frame.planes[0]
    rows = np.frombuffer(memoryview(plane), dtype=np.uint8).reshape(-1, plane.line_size)
    return np.ascontiguousarray(rows[: frame.height, : frame.width])


def stamp_issues(name: str, time: Array, backwards: int, rotation: int) -> tuple[str, ...]:
    """Faults of time stamps (t,) s in order, and what was done about them, one sentence each.

    >>> (issue,) = stamp_issues("film.mp4", np.array([0.0, 0.04, 0.08, 0.20, 0.24]), 0, 0)
    >>> issue.partition(". ")[2]
    'The longest gap is 0.120 s after 0.080 s, the usual step 0.0400 s.'
    """
    issues = []
    if backwards:
        issues.append(
            f"{name}: {backwards} time stamps run backwards. Frames keep the decoder's order and take the "
            "sorted time stamps."
        )
    step = np.diff(time)
    usual = float(np.median(step)) if len(step) else 0.0
    repeated = np.flatnonzero(step == 0)
    if len(repeated):
        issues.append(
            f"{name}: {len(repeated)} frames repeat the time stamp before them, the first at "
            f"{time[repeated[0]]:.3f} s."
        )
    gaps = np.flatnonzero(step > 1.5 * usual) if usual > 0 else np.empty(0, dtype=np.intp)
    if len(gaps):
        longest = gaps[np.argmax(step[gaps])]
        issues.append(
            f"{name}: frames are missing in {len(gaps)} places. The longest gap is {step[longest]:.3f} s "
            f"after {time[longest]:.3f} s, the usual step {usual:.4f} s."
        )
    if rotation == 180:  # by 90 degrees the sizes tell whether film and board images lie alike
        issues.append(
            f"{name}: the file asks to be turned upside down, which is done. "
            "Are the board images the same way up?"
        )
    return tuple(issues)


def _interlaced(name: str, frame: VideoFrame) -> tuple[str, ...]:
    """A sentence where a film is marked as holding two moments in a frame, which some are that do not."""
    if not frame.interlaced_frame:
        return ()
    return (
        f"{name} is marked as interlaced: odd and even rows of a frame then show two moments, and a marker "
        f"that moves is torn between them, which no stated error covers. {WHOLE}.",
    )


class Writer:
    """Encodes grey pictures with exact time stamps; the file appears under its name when it is complete.

    options: of the encoder, in place of crf, preset medium, tune grain and no B-frames.
    grey: no colour in the file, which takes a seventh of the time; not every player shows it.
    shown: the first frames, which alone are written; the coder looks ahead at the others.
    """

    def __init__(
        self,
        path: Path,
        size: tuple[int, int],
        *,
        fps: float,
        codec: str,
        crf: float = 18.0,
        options: dict[str, str] | None = None,
        grey: bool = False,
        shown: int = sys.maxsize,
    ) -> None:
        if size[0] % 2 or size[1] % 2:
            raise ValueError(
                f"film of {size[0]} x {size[1]} px cannot be coded: width and height must be even"
            )
        self.path, self.partial = path, path.with_name(f".partial-{path.name}")
        self.container = av.open(str(self.partial), "w")
        rate = Fraction(fps).limit_denominator(1000)
        if options is None:
            grain = {"crf": str(crf), "preset": "medium", "tune": "grain", "bf": "0"}
            grain |= {"x264-params": SAME_BITS}
            options = grain if codec == "libx264" else {}
        stream: Any = self.container.add_stream(codec, rate=rate, options=options)
        stream.width, stream.height = size
        stream.pix_fmt = "gray" if grey else "yuv420p"
        stream.codec_context.time_base = 1 / rate
        stream.codec_context.thread_count = CODING_THREADS
        self.stream, self.frames, self.shown, self.left = stream, 0, shown, shown

    def __enter__(self) -> "Writer":
        return self

    def add(self, grey: Image) -> None:
        frame = _frame(grey, self.stream.pix_fmt)
        frame.pts = self.frames
        frame.time_base = self.stream.codec_context.time_base
        self.frames += 1
        self._write(frame)

    def _write(self, frame: av.VideoFrame | None) -> None:
        """Code a frame, or what is left of all of them, until those that are shown are written."""
        packets = self.stream.codec_context.encode_lazy(frame) if self.left else ()
        for packet in packets:
            self.left -= packet.pts < self.shown
            packet.stream = self.stream
            self.container.mux(packet)
            if not self.left:  # to ask for the next one would code it
                return

    def __exit__(self, kind: object, *_: object) -> None:
        try:
            if kind is None:
                self._write(None)
            self.container.close()  # which writes, and may find no room
            if kind is None:
                os.replace(self.partial, self.path)
        finally:
            self.partial.unlink(missing_ok=True)


def _frame(grey: Image, form: str) -> av.VideoFrame:
    """A frame, gray or yuv420p, whose luma plane is the picture itself."""
    if form == "gray":
        return av.VideoFrame.from_ndarray(grey, format=form)
    height, width = grey.shape
    chroma = np.full((height // 2, width), 128, dtype=np.uint8)
    return av.VideoFrame.from_ndarray(np.concatenate([grey, chroma]), format=form)
