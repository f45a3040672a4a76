"""Pinhole cameras: from pixels to rays and from points to pixels. OpenGL axes, pixel centres at +0.5."""

import numpy as np
import torch
from torch import Tensor

from pacnerf_lpo.types import Box, Rays

NEAR = 0.1
"""Nothing nearer to a camera is rendered [m]."""


def pixel_rays(intrinsic: Tensor, camera_to_world: Tensor, height: int, width: int) -> Rays:
    """One ray through the centre of every pixel, row by row, of intrinsics without skew [pixels, (3, 3)] and a pose
    [rotation and metres, (3, 4)]. All origins are one point, stored once.
    """
    return rays_through(pixel_centres(intrinsic, height, width), camera_to_world)


def pixel_centres(intrinsic: Tensor, height: int, width: int) -> Tensor:
    """Image coordinates x / z (right) and y / z (up) of every pixel's centre, row by row [(H * W, 2), float64]."""
    rows, columns = torch.meshgrid(
        torch.arange(height, dtype=torch.float64) + 0.5, torch.arange(width, dtype=torch.float64) + 0.5, indexing="ij"
    )
    intrinsic = intrinsic.double()
    right = (columns - intrinsic[0, 2]) / intrinsic[0, 0]
    up = (intrinsic[1, 2] - rows) / intrinsic[1, 1]
    return torch.stack((right, up), dim=-1).reshape(-1, 2)


def rays_through(image_coordinates: Tensor, camera_to_world: Tensor) -> Rays:
    """The float32 rays of a pinhole camera through points (R, 2) of the image plane x / z, y / z; differentiable."""
    pose = camera_to_world.double()
    in_camera = torch.cat((image_coordinates, -torch.ones_like(image_coordinates[:, :1])), dim=-1)
    directions = torch.nn.functional.normalize(in_camera @ pose[:, :3].T, dim=-1).float()
    return Rays(origins=pose[:, 3].float().expand_as(directions), directions=directions)


def poses_around(target: np.ndarray, distance: float, azimuth: np.ndarray, elevation: np.ndarray) -> np.ndarray:
    """Poses [rotation and metres, (..., 3, 4)] of cameras that look at a point [m, (3,)] from a distance [m], at an
    azimuth [rad, (...)], 0 looks along -z, a quarter turn along -x, and an elevation over the horizon [rad, (...)].
    """
    across, none = np.cos(elevation), np.zeros_like(azimuth)
    back = np.stack((across * np.sin(azimuth), np.sin(elevation), across * np.cos(azimuth)), axis=-1)
    right = np.stack((np.cos(azimuth), none, -np.sin(azimuth)), axis=-1)
    return np.stack((right, np.cross(back, right), back, target + distance * back), axis=-1)


def project(points: Tensor, intrinsic: Tensor, camera_to_world: Tensor) -> tuple[Tensor, Tensor]:
    """Pixel coordinates [(N, 2), x right, y down] and depth along the axis [m, (N,)] of world points [m, (N, 3)].

    A point is in front of the camera where its depth is positive; elsewhere its pixel coordinates mean nothing.
    """
    right, up, back = camera_to_world[:, :3].T @ (points - camera_to_world[:, 3]).T  # so each is contiguous
    depth = -back
    x = intrinsic[0, 2] + intrinsic[0, 0] * right / depth
    y = intrinsic[1, 2] - intrinsic[1, 1] * up / depth
    return torch.stack((x, y), dim=-1), depth


def hits_box(rays: Rays, box: Box) -> Tensor:
    """Whether each ray passes through the box in front of its origin [(R,), bool] (slab test)."""
    enter, leave = box_interval(rays, rays.origins.new_tensor(box.lower), rays.origins.new_tensor(box.upper), 0.0)
    return leave > enter


def box_interval(rays: Rays, lower: Tensor, upper: Tensor, near: float = NEAR) -> tuple[Tensor, Tensor]:
    """Distances [m, (R,), (R,)] at which rays enter (not before ``near``) and leave a box; enter > leave is a miss."""
    directions = torch.where(rays.directions.abs() < 1e-12, 1e-12, rays.directions)
    one, two = (lower - rays.origins) / directions, (upper - rays.origins) / directions
    return torch.minimum(one, two).amax(1).clamp_min(near), torch.maximum(one, two).amin(1)
