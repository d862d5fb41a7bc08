"""Films: pictures of one size as MP4 (H.264) or GIF; the same pictures give the same bytes."""

import subprocess
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Final

from PIL import Image

_SAID: Final = 500
"""Characters of ffmpeg's complaint that are kept, the last ones."""
_GIF: Final = (
    "scale=trunc(iw*0.55):-1:flags=area,split[a][b];[a]palettegen=max_colors=64[p];[b][p]paletteuse=dither=none"
)
"""Filter of ffmpeg for a size and colors at which 30 s of film are about 1 MB, and words readable."""


class FilmError(Exception):
    """A film can't be encoded."""


def write_film(file: Path, pictures: Iterable[Image.Image], picture_ms: int, last_ms: int = 0, crf: int = 23) -> None:
    """Write RGB pictures (one or more) as H.264, which every browser plays, or smaller as GIF if `file` has that suffix.

    Args:
        picture_ms: Duration of a picture.
        last_ms: Duration of the last picture, if it is longer.
        crf: Of x264, from 0 (lossless) to 51.

    Raises:
        FilmError: ffmpeg fails.
        OSError: the file can't be written.
    """
    waiting = iter(pictures)
    first = next(waiting)
    # H.264 halves the resolution of colors, so both sides are even. One thread and no version of the encoder in the file: its bytes
    # follow from the pictures.
    kind = [
        *("-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white", "-pix_fmt", "yuv420p"),
        *("-c:v", "libx264", "-preset", "fast", "-tune", "animation", "-crf", str(crf)),
        *("-fflags", "+bitexact", "-flags:v", "+bitexact", "-bsf:v", "filter_units=remove_types=6"),
        *("-movflags", "+faststart", "-f", "mp4"),
    ]
    command = [
        _encoder(),
        *("-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{first.width}x{first.height}"),
        *("-framerate", f"1000/{picture_ms}", "-i", "-", "-an", "-map_metadata", "-1", "-threads", "1"),
        *(["-vf", _GIF, "-f", "gif"] if file.suffix.lower() == ".gif" else kind),
        *("-y", str(file)),
    ]
    file.touch()  # so that a folder that can't be written is an OSError
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as encoder:
        assert encoder.stdin is not None and encoder.stderr is not None
        try:
            for picture in _held(chain([first], waiting), picture_ms, last_ms):
                encoder.stdin.write(picture.tobytes())
            encoder.stdin.close()
        except BrokenPipeError:
            pass
        except BaseException:
            encoder.kill()
            raise
        said = encoder.stderr.read().decode(errors="replace")
    if encoder.returncode:
        file.unlink(missing_ok=True)
        raise FilmError(f"ffmpeg ended with {encoder.returncode}: {' '.join(said.split())[-_SAID:]}")


def _encoder() -> str:
    from imageio_ffmpeg import get_ffmpeg_exe

    try:
        return str(get_ffmpeg_exe())
    except RuntimeError as error:  # a system that imageio-ffmpeg has no wheel for, and none is installed
        raise FilmError(" ".join(str(error).split())) from None


def _held(pictures: Iterable[Image.Image], picture_ms: int, last_ms: int) -> Iterator[Image.Image]:
    picture = None
    for picture in pictures:
        yield picture
    if picture is not None:
        yield from [picture] * (last_ms // picture_ms - 1)
