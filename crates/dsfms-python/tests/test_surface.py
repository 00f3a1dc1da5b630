"""Template, surface, tracker, errors."""

import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import COARSE, ROOT, first, pixels
from numpy.typing import NDArray

import dsfms


def test_template(template: dsfms.Template, camera: dsfms.Camera, tmp_path: Path) -> None:
    n, m = len(template.vertices), len(template.faces)
    assert template.vertices.shape == (n, 3) and template.vertices.dtype == np.float64
    assert template.faces.shape == (m, 3) and template.faces.max() == n - 1
    assert template.uv is not None and template.uv.shape == (m, 3, 2)
    texture = template.albedo_texture(64)
    assert texture is not None and texture.shape == (64, 64, 3) and 0 < texture.max() < 10
    colors = template.albedo_vertices
    assert colors is not None and colors.shape == (n, 3)
    assert template.unit == "template_units" and template.sigma.shape == (n,)
    assert 2 <= len(template.poses) <= 16 and not template.rejected
    for pose in template.poses.values():
        assert np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3))
    assert template.points.shape == template.point_colors.shape and len(template.points) > 100
    assert template.camera is not None and template.camera.size == camera.size
    assert template.light is not None and template.feature_count > 100
    assert "<table>" in template._repr_html_() and "data:image/png" in template._repr_html_()
    assert f"{n} vertices" in repr(template)
    png = template.albedo_png(32)
    assert png is not None and png.startswith(b"\x89PNG")
    template.save(tmp_path / "organ.template")
    again = dsfms.Template.load(tmp_path / "organ.template")
    assert np.array_equal(again.vertices, template.vertices)
    with pytest.raises(dsfms.FileError, match="no template at"):
        dsfms.Template.load(tmp_path / "nothing")
    with pytest.raises(ValueError, match="size: expected"):
        template.albedo_texture(1)


def test_a_template_of_a_bare_mesh() -> None:
    case = dsfms.synthesize(vertices=120, matches=80, everywhere=True)
    bare = dsfms.Template.from_mesh(case.template.vertices, case.template.faces)
    assert bare.unit == "mm" and bare.camera is None and bare.albedo_texture(64) is None
    surface = dsfms.reconstruct(bare, case.image, case.camera, method="dsfm", matches=case.matches)
    assert surface.vertices.shape == case.truth.shape
    with pytest.raises(dsfms.ReconstructionError, match="albedo"):
        dsfms.reconstruct(bare, case.image, case.camera, method="joint", matches=case.matches)
    with pytest.raises(ValueError, match="camera: expected"):
        dsfms.reconstruct(bare, case.image, matches=case.matches)
    with pytest.raises(ValueError, match="faces: expected"):
        dsfms.Template.from_mesh(case.template.vertices, [[0, 1, 100000]])


def test_surface(surface: dsfms.Surface, template: dsfms.Template) -> None:
    n = len(template.vertices)
    assert surface.vertices.shape == (n, 3) and np.isfinite(surface.vertices).all()
    assert surface.pose.shape == (4, 4) and surface.visible.shape == (n,) and surface.visible.any()
    assert surface.expected_error is not None and surface.expected_error.shape == (n,)
    assert surface.expected_error_bound is not None and surface.expected_error_bound > 1
    assert surface.observed is not None and surface.observed.dtype == bool
    assert surface.status in (dsfms.Status.OK, dsfms.Status.DEGRADED)
    assert surface.matches.shape == (len(surface.matches_kept), 6) and surface.matches_kept.any()
    terms = surface.costs["register (eq. 3)"]
    assert all(after >= 0 for _, after in terms.values())
    assert surface.seconds and surface.gain == 1.0 and surface.ambient == 0.0
    assert np.isnan([surface.photometric, surface.agreement, surface.depth_uncertainty]).all()
    assert surface.camera_pose is None
    assert np.array_equal(surface.faces, template.faces) and surface.template is template
    assert "Surface(" in repr(surface)


def test_memory_and_files_agree(
    scene: Path, camera: dsfms.Camera, template: dsfms.Template
) -> None:
    frames = [pixels(p) for p in sorted((scene / "exploration").iterdir())]
    masks = [pixels(p)[..., 0] for p in sorted((scene / "exploration_masks").iterdir())]
    seen: list[tuple[str, int, int]] = []
    built = dsfms.build_template(
        frames, camera, organ_masks=masks, vertices=300, options=COARSE, progress=lambda *step: seen.append(step)
    )
    assert np.array_equal(built.vertices, template.vertices)
    assert {"features", "matching"} <= {stage for stage, _, _ in seen}
    assert all(done <= total for _, done, total in seen)


def test_poses_and_masks_stay_with_their_frames(
    scene: Path, camera: dsfms.Camera, template: dsfms.Template, tmp_path: Path
) -> None:
    names = list(template.poses)[:4]
    paths = [scene / "exploration" / f"{name}.png" for name in names]
    poses = [template.poses[name] for name in names]
    # A file that cannot be read, with a pose of its own among the others.
    broken = tmp_path / "frame_900.png"
    broken.write_bytes(paths[0].read_bytes()[:300])
    paths.insert(1, broken)
    poses.insert(1, np.eye(4))
    mesh = (template.vertices, template.faces)
    built = dsfms.build_template(paths, camera, mesh=mesh, poses=poses, options=COARSE)
    for name in names:
        assert np.allclose(built.poses[name], template.poses[name], atol=1e-9)
    with pytest.raises(ValueError, match="poses: expected one for each of 5 frames, found 4"):
        dsfms.build_template(paths, camera, mesh=mesh, poses=poses[:4], options=COARSE)
    with pytest.raises(ValueError, match="organ_masks: expected one for each of 5 frames, found 1"):
        whole = np.full((camera.size[1], camera.size[0]), 255, np.uint8)
        dsfms.build_template(paths, camera, organ_masks=[whole], options=COARSE)


def test_organ_masks_of_some_frames_are_enough(
    scene: Path, camera: dsfms.Camera, tmp_path: Path
) -> None:
    for path in sorted((scene / "exploration_masks").iterdir())[:3]:
        shutil.copy(path, tmp_path / path.name)
    seen: list[str] = []
    with pytest.raises(StopIteration):

        def stop(stage: str, done: int, total: int) -> None:
            seen.append(stage)
            raise StopIteration(stage)

        dsfms.build_template(scene / "exploration", camera, organ_masks=tmp_path, progress=stop)
    assert seen


def test_a_seed_of_the_options_counts(template: dsfms.Template, scene: Path, camera: dsfms.Camera) -> None:
    image = first(scene / "deformed")

    def vertices(**more: object) -> NDArray[np.float64]:
        return dsfms.reconstruct(template, image, camera, method="dsfm", **more).vertices  # type: ignore[arg-type]

    seven = vertices(seed=7)
    assert np.array_equal(vertices(options="seed = 7"), seven)
    assert not np.array_equal(vertices(), seven)


def test_wrong_frames_are_named(camera: dsfms.Camera, scene: Path) -> None:
    with pytest.raises(ValueError, match=r"frames\[0\]: expected the camera's size"):
        dsfms.build_template([np.zeros((10, 10, 3), np.uint8)], camera)
    with pytest.raises(ValueError, match="frames: expected frames, found none"):
        dsfms.build_template([], camera)
    with pytest.raises(dsfms.FileError, match="nowhere"):
        dsfms.build_template(scene / "nowhere", camera)
    width, height = camera.size
    with pytest.raises(dsfms.BuildError):
        dsfms.build_template([np.zeros((height, width, 3), np.uint8)] * 3, camera)
    with pytest.raises(ValueError, match="poses: expected"):
        dsfms.build_template(scene / "exploration", camera, mesh=([[0, 0, 0]], [[0, 0, 0]]))


def test_a_callback_may_stop_the_work(scene: Path, camera: dsfms.Camera) -> None:
    def stop(stage: str, done: int, total: int) -> None:
        raise StopIteration(stage)

    begin = time.monotonic()
    with pytest.raises(StopIteration):
        dsfms.build_template(scene / "exploration", camera, progress=stop)
    assert time.monotonic() - begin < 5


LONG = """
import sys, dsfms
print("go", flush=True)
try:
    dsfms.build_template(sys.argv[1] + "/exploration", sys.argv[1] + "/camera.json", vertices=300)
except KeyboardInterrupt:
    print("stopped", flush=True)
"""


def test_ctrl_c_stops_a_long_call(scene: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", LONG, str(scene)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None and process.stdout.readline() == "go\n"
    time.sleep(0.7)
    begin = time.monotonic()
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=60)
    assert out == "stopped\n" and time.monotonic() - begin < 10


def test_python_goes_on_during_a_call(
    template: dsfms.Template, image: NDArray[np.uint8], camera: dsfms.Camera
) -> None:
    ticks, stop = [0], threading.Event()

    def count() -> None:
        while not stop.wait(0.001):
            ticks[0] += 1

    thread = threading.Thread(target=count)
    thread.start()
    surface = dsfms.reconstruct(template, image, camera, method="dsfm")
    stop.set()
    thread.join()
    assert ticks[0] > 1000 * 0.02 * sum(surface.seconds.values())


def test_a_black_frame_gives_no_surface(template: dsfms.Template, camera: dsfms.Camera) -> None:
    width, height = camera.size
    with pytest.raises(dsfms.ReconstructionError, match="black") as error:
        dsfms.reconstruct(template, np.zeros((height, width, 3), np.uint8), camera)
    assert isinstance(error.value, dsfms.DsfmsError)


def test_tracker(clip: Path) -> None:
    template = dsfms.Template.load(clip / "organ.template")
    tracker = dsfms.Tracker(template, clip / "camera.json")
    frames = list(dsfms.Frames(clip / "frames"))
    assert len(frames) == dsfms.frame_count(clip / "frames") == 12
    assert np.array_equal(frames[0], pixels(first(clip / "frames")))
    pushed = [tracker.push(frame) for frame in frames]
    iterated = list(dsfms.Tracker(template, clip / "camera.json").track(frames))
    assert [s.status for s in pushed] == [s.status for s in iterated]
    assert all(np.array_equal(a.vertices, b.vertices, equal_nan=True) for a, b in zip(pushed, iterated, strict=True))
    good = [s for s in pushed if s.status is not dsfms.Status.LOST]
    assert len(good) >= 6 and good[0].visible.any() and good[0].expected_error is None
    assert good[0].expected_error_bound is None
    lost = tracker.push(np.zeros_like(frames[0]))
    assert lost.status is dsfms.Status.LOST and np.isnan(lost.vertices).all() and np.isnan(lost.pose).all()
    assert not lost.visible.any() and lost.reasons
    assert isinstance(tracker.track([]), dsfms.Tracking) and tracker.template is template
    with pytest.raises(ValueError, match="frame: expected the camera's size"):
        tracker.push(frames[0][:100])


def test_a_stretch_of_frames(clip: Path) -> None:
    everything = list(dsfms.Frames(clip / "frames"))
    part = list(dsfms.Frames(clip / "frames", 3, 5))
    assert len(part) == 2 and np.array_equal(part[0], everything[3])
    with pytest.raises(ValueError, match="stop: expected"):
        dsfms.Frames(clip / "frames", 3, 2)
    with pytest.raises(dsfms.FileError):
        next(dsfms.Frames(clip / "nowhere.mp4"))


def test_what_cannot_be_tracked(clip: Path) -> None:
    template = dsfms.Template.load(clip / "organ.template")
    bare = dsfms.Template.from_mesh(template.vertices, template.faces)
    with pytest.raises(dsfms.TrackingError, match="descriptors"):
        dsfms.Tracker(bare, clip / "camera.json")
    with pytest.raises(dsfms.TrackingError, match="does not track"):
        dsfms.Tracker(template, clip / "camera.json", method="sfs")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="options: expected"):
        dsfms.Tracker(template, clip / "camera.json", options="patience = 'long'")


def test_every_vertex_has_its_region(surface: dsfms.Surface) -> None:
    regions = surface.regions
    assert regions is not None and regions.dtype == np.uint8 and len(regions) == len(surface.vertices)
    assert np.array_equal(regions == dsfms.Region.HIDDEN, ~surface.visible)
    assert (regions == dsfms.Region.OBSERVED).any()


def test_a_surface_that_is_not_believed_is_lost(
    template: dsfms.Template, image: NDArray[np.uint8], camera: dsfms.Camera, surface: dsfms.Surface
) -> None:
    """Matches of one small place leave the pose open."""
    matches = surface.matches[surface.matches_kept]
    near = np.argsort(np.linalg.norm(matches[:, 4:] - matches[0, 4:], axis=1))[:8]
    found = dsfms.reconstruct(template, image, camera, method="dsfm", matches=matches[near])
    assert found.status is dsfms.Status.LOST and np.isnan(found.vertices).all() and found.regions is None
    assert any(reason.kind is dsfms.ReasonKind.POSE_UNCERTAIN for reason in found.reasons)


def test_every_reason_of_the_library_has_its_kind() -> None:
    text = (ROOT / "crates/dsfms/src/verdict/reason.rs").read_text()
    _, _, rest = text.partition("pub enum Reason {\n")
    body, _, _ = rest.partition("\n}\n")
    variants = re.findall(r"^    ([A-Z][A-Za-z]+)(?:,| \{|\()", body, re.MULTILINE)
    snake = {re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower() for name in variants}
    assert snake == {kind.value for kind in dsfms.ReasonKind} and len(snake) > 20


def test_a_damaged_frame_is_lost_alone(clip: Path, tmp_path: Path) -> None:
    frames = tmp_path / "frames"
    shutil.copytree(clip / "frames", frames)
    names = sorted(frames.iterdir())
    names[2].write_bytes(b"no picture")
    images = dsfms.Frames(frames)
    assert images.number is None
    with pytest.warns(dsfms.DsfmsWarning, match=f"{names[2].stem} is lost"):
        numbers = [images.number for _ in images]
    assert numbers == [0, 1, *range(3, len(names))] and dsfms.frame_count(frames) == len(names)
    template = dsfms.Template.load(clip / "organ.template")
    surfaces = list(dsfms.Tracker(template, clip / "camera.json").track(frames))
    assert len(surfaces) == len(names) and surfaces[2].frame == names[2].stem
    assert surfaces[2].status is dsfms.Status.LOST and surfaces[1].status is not dsfms.Status.LOST
    (reason,) = surfaces[2].reasons
    assert reason.kind is dsfms.ReasonKind.INPUT and names[2].name in reason.text
    assert reason.figures == {"why": reason.text}


def test_a_damaged_video_loses_one_frame() -> None:
    frames = dsfms.Frames(ROOT / "crates/dsfms/tests/corpus/mp4/damaged-400-bytes.mp4")
    with pytest.warns(dsfms.DsfmsWarning, match="is lost"):
        numbers = [frames.number for _ in frames]
    assert len(numbers) == 14 and set(numbers) < set(range(15))
