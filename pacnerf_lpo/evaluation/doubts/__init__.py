"""What a careful colleague would say about a fit: every doubt in one place, from states, courses and images."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pacnerf_lpo.data.video_data import VideoData
from pacnerf_lpo.evaluation.doubts import identification, recording
from pacnerf_lpo.evaluation.doubts.doubt import Doubt
from pacnerf_lpo.evaluation.doubts.images import doubts_about_images
from pacnerf_lpo.evaluation.run_directory import Stage
from pacnerf_lpo.mpm.physics import Physics

__all__ = ["Doubt", "doubts_of_phase", "doubts_of_run"]


def doubts_of_phase(data: VideoData, physics: Physics, stage: Stage) -> Iterator[Doubt]:
    """The doubts that a finished phase of a run raises, by its state, and by its course where that led there."""
    state, course = stage.state, stage.record.course
    if stage.record.phase == "static":
        yield from recording.doubts_about_views(data)
        yield from recording.doubts_about_pixels(data, state)
    elif stage.record.phase == "velocity" and (fall := recording.measure_fall(data)):
        yield from recording.doubts_about_ground(fall, physics.ground_height, state.spacing)
        if "frames" in course:
            yield from recording.doubts_about_contact(fall, course["frames"])
    elif stage.record.phase == "physics":
        yield from identification.doubts_about_parameters(physics, state, course.get("searched", {}))
        if stage.record.before is None:
            yield from identification.doubts_about_identification(course, physics)
        yield from identification.doubts_about_methods(stage.record.methods, physics)


def doubts_of_run(
    data: VideoData, physics: Physics, stages: Sequence[Stage], results: Mapping[str, Any]
) -> list[Doubt]:
    """The doubts about a result: those of the last phase of each kind, and those that its images raise. Of a velocity
    that still moved when its phase ended there is no doubt where the identification has fitted it again.

    Stages are those up to the one whose result counts; results are of their evaluation, with the intervals where there
    are any.
    """
    latest = {stage.record.phase: stage for stage in stages}
    found = [doubt for stage in latest.values() for doubt in doubts_of_phase(data, physics, stage)]
    fitted_again = "physics" in latest and latest["physics"].record.course.get("fits_velocity", False)
    if "velocity" in latest and not fitted_again:
        state, course = latest["velocity"].state, latest["velocity"].record.course
        if "frames" in course:
            seconds = float(data.video.times[course["frames"] - 1] - data.video.times[0])
            pixel = recording.pixel_size(data, state)
            found += identification.doubts_about_velocity(course, state, pixel, seconds)
    intervals = results.get("intervals")
    for stage in stages:
        if intervals is not None and stage.stem == intervals["phase"]:
            had = stage.record.before or stage.state.physics
            found += identification.doubts_about_intervals(physics, had, intervals)
    seen = [phase for phase in results["phases"] if "images" in phase and phase["stem"] in {s.stem for s in stages}]
    moving = [phase for phase in seen if phase["phase"] != "static"]
    return [*found, *doubts_about_images(results, (moving or seen)[-1])] if seen else found
