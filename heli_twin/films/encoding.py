"""Frames into a file: MP4 by PyAV, GIF by Pillow."""

from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

from PIL import Image

from heli_twin.errors import HeliTwinError
from heli_twin.terminal_text import clean

NEEDS_PYAV = "an MP4 needs PyAV: pip install 'heli-twin[film]', or give a name that ends in .gif, which needs nothing"
NEEDS_H264 = "this build of PyAV has no H.264 encoder: give a name that ends in .gif"
QUALITY = {"crf": "21", "preset": "veryfast"}
THREADS = 2
"""A fixed number: the encoder's output depends on it."""
GIF_COLORS = 128
GIF_TICK_S = 0.01
"""A GIF counts in hundredths of a second."""


def require_encoder(file: Path) -> None:
    """Check that a file of this name can be written here.

    Raises:
        HeliTwinError: It has another ending, or the encoder is missing.
    """
    if file.suffix not in (".mp4", ".gif"):
        raise HeliTwinError(f"cannot write {file}: give the film a name that ends in .mp4 or .gif")
    if file.suffix == ".mp4":
        _av()


def _av() -> Any:
    try:
        import av
        import av.codec
    except ImportError:
        raise HeliTwinError(NEEDS_PYAV) from None
    try:
        av.codec.Codec("h264", "w")
    except ValueError:
        raise HeliTwinError(NEEDS_H264) from None
    return av


def encode(frames: Iterator[Image.Image], file: Path, kind: str, fps: float, kept: Sequence[str] = ()) -> None:
    """Write frames, all of one even size, to a file.

    Args:
        frames: At least one.
        file: Where to write.
        kind: `.mp4` or `.gif`; the file may have another ending.
        fps: Frames a second.
        kept: Colours that a GIF, which has few, shall have.

    Raises:
        OSError: The file cannot be written.
        HeliTwinError: The encoder says so, or cannot encode.
    """
    if kind == ".mp4":
        av = _av()
        try:
            _mp4(av, frames, file, fps)
        except av.error.FFmpegError as error:
            raise HeliTwinError(f"the film cannot be written: {clean(error, 200)}") from None
    else:
        _gif(frames, file, fps, kept)


def _mp4(av: Any, frames: Iterator[Image.Image], file: Path, fps: float) -> None:
    with av.open(str(file), "w", format="mp4", options={"movflags": "+faststart"}) as container:
        stream: Any = None
        for picture in frames:
            if stream is None:
                stream = container.add_stream("h264", rate=Fraction(fps).limit_denominator(1000), options=dict(QUALITY))
                stream.width, stream.height, stream.pix_fmt = *picture.size, "yuv420p"
                stream.codec_context.thread_count = THREADS
            container.mux(stream.encode(av.VideoFrame.from_image(picture)))
        container.mux(stream.encode(None))


def _gif(frames: Iterator[Image.Image], file: Path, fps: float, kept: Sequence[str]) -> None:
    first = next(frames)
    sample = first.copy()
    for i, color in enumerate(kept):
        sample.paste(color, (0, 24 * i, 24, 24 * i + 24))
    palette = sample.quantize(GIF_COLORS, dither=Image.Dither.NONE)
    begin = first.quantize(palette=palette, dither=Image.Dither.NONE)

    def reduced() -> Iterator[Image.Image]:
        for picture in frames:
            yield picture.quantize(palette=palette, dither=Image.Dither.NONE)

    duration = 1e3 * GIF_TICK_S * max(2, round(1 / (fps * GIF_TICK_S)))
    begin.save(file, "GIF", save_all=True, append_images=reduced(), duration=duration, loop=0, optimize=False)
