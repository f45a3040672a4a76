"""Particles as USD points that move."""

from pathlib import Path

import numpy as np

from pacnerf_lpo.export.files import whole_file
from pacnerf_lpo.export.motion import Subject, linear_light
from pacnerf_lpo.export.points import frames_of

ROUGHNESS = 0.6


def write_usd(subject: Subject, path: Path) -> None:
    """Write a stage with one ``Points`` prim, /Body/Particles: positions [m] and velocities [m/s] at every frame.

    Y is up, a unit is a metre, and time codes are video frames. Points are as wide as the cubes that they fill at frame
    0, and their colours (linear light) reach a UsdPreviewSurface by a primvar. The identified parameters [SI units] are
    custom data of the layer.
    """
    from pxr import Gf, Usd, UsdGeom, Vt

    motion = subject.motion
    with whole_file(path) as part:
        stage = Usd.Stage.CreateNew(str(part))
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        codes = (motion.times * motion.frame_rate).round(6).tolist()
        stage.SetTimeCodesPerSecond(motion.frame_rate)
        stage.SetFramesPerSecond(motion.frame_rate)
        stage.SetStartTimeCode(codes[0])
        stage.SetEndTimeCode(codes[-1])
        stage.GetRootLayer().customLayerData = {"identified_SI": motion.parameters}
        body = UsdGeom.Xform.Define(stage, "/Body").GetPrim()
        stage.SetDefaultPrim(body)
        points = UsdGeom.Points.Define(stage, "/Body/Particles")
        points.CreateIdsAttr(Vt.Int64Array.FromNumpy(motion.numbers))
        points.CreateWidthsAttr(Vt.FloatArray([motion.distance]))
        points.SetWidthsInterpolation(UsdGeom.Tokens.constant)
        colour = points.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex)
        colour.Set(Vt.Vec3fArray.FromNumpy(linear_light(motion.colours)))
        _bind_material(stage, points.GetPrim())
        reach = np.float32(motion.distance / 2)
        for frame in frames_of(len(codes), path):
            here, code = motion.positions[frame], codes[frame]
            points.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(here)), code)
            moving = np.ascontiguousarray(motion.velocities[frame])
            points.GetVelocitiesAttr().Set(Vt.Vec3fArray.FromNumpy(moving), code)
            corners = [Gf.Vec3f(*corner.tolist()) for corner in (here.min(0) - reach, here.max(0) + reach)]
            points.GetExtentAttr().Set(Vt.Vec3fArray(corners), code)
        stage.GetRootLayer().Save()


def _bind_material(stage, prim) -> None:
    """A UsdPreviewSurface whose diffuse colour is the prim's displayColor."""
    from pxr import Sdf, UsdShade

    material = UsdShade.Material.Define(stage, "/Body/Material")
    reader = UsdShade.Shader.Define(stage, "/Body/Material/Colour")
    reader.CreateIdAttr("UsdPrimvarReader_float3")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("displayColor")
    colour = reader.CreateOutput("result", Sdf.ValueTypeNames.Float3)
    surface = UsdShade.Shader.Define(stage, "/Body/Material/Surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(colour)
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(ROUGHNESS)
    shown = surface.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput().ConnectToSource(shown)
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material)
