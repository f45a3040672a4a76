"""Particles as PLY, VTU with a PVD, CSV, and as USD points that move."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.lib.recfunctions import unstructured_to_structured
from plyfile import PlyData, PlyElement
from tqdm import tqdm

from pacnerf_lpo.export.files import whole_file, whole_folder
from pacnerf_lpo.export.motion import Subject, linear_light

SERIES = "motion.pvd"
VERTEX = np.dtype(
    [(name, "f4") for name in ("x", "y", "z", "vx", "vy", "vz")]
    + [(name, "u1") for name in ("red", "green", "blue")]
    + [("density", "f4")]
)
CSV_HEADER = "frame,time_s,id,x_m,y_m,z_m"
ROUGHNESS = 0.6


def write_ply(subject: Subject, folder: Path) -> None:
    """Write ``frame_000.ply`` and so on.

    A vertex holds its position x, y, z [m], velocity vx, vy, vz [m/s], colour and raw volume density.
    """
    motion = subject.motion
    with whole_folder(folder) as part:
        for frame in frames_of(len(motion.times), folder):
            moving = motion.positions[frame], motion.velocities[frame]
            columns = np.column_stack((*moving, motion.colours, motion.density))
            vertices = unstructured_to_structured(columns, VERTEX)
            PlyData([PlyElement.describe(vertices, "vertex")]).write(part / f"frame_{frame:03d}.ply")


def write_vtu(subject: Subject, folder: Path) -> None:
    """Write ``frame_000.vtu`` and so on, and ``motion.pvd``, which lists them with their times [s].

    A point is a vertex cell with velocity [m/s], colour [0..255], raw density, fraction [0..1] and its number, id.
    """
    import meshio

    motion = subject.motion
    cells = [("vertex", np.arange(len(motion.numbers))[:, None])]
    fixed = {"colour": motion.colours, "density": motion.density, "fraction": motion.fraction, "id": motion.numbers}
    root = ElementTree.Element("VTKFile", type="Collection", version="0.1", byte_order="LittleEndian")
    collection = ElementTree.SubElement(root, "Collection")
    with whole_folder(folder) as part:
        for frame in frames_of(len(motion.times), folder):
            name = f"frame_{frame:03d}.vtu"
            values = {"velocity": motion.velocities[frame], **fixed}
            meshio.Mesh(motion.positions[frame], cells, values).write(part / name, file_format="vtu")
            ElementTree.SubElement(collection, "DataSet", timestep=f"{motion.times[frame]:.9g}", part="0", file=name)
        ElementTree.indent(root)
        ElementTree.ElementTree(root).write(part / SERIES, encoding="utf-8", xml_declaration=True)


def write_csv(subject: Subject, path: Path) -> None:
    """Write one row for each frame and particle: frame, time [s], id, position [m] to a micrometre.

    The columns are those of ``data.tracks``, so that the file can stand in for measured tracks.
    """
    motion = subject.motion
    with whole_file(path) as part, open(part, "w", encoding="utf-8") as file:
        file.write(CSV_HEADER + "\n")
        for frame in frames_of(len(motion.times), path):
            table = np.column_stack((motion.numbers, motion.positions[frame]))
            np.savetxt(file, table, fmt=f"{frame},{motion.times[frame]:.9g},%d,%.6f,%.6f,%.6f")


def frames_of(frames: int, path: Path) -> tqdm:
    """The numbers of so many frames, with a bar where they take long."""
    return tqdm(range(frames), desc=f"writing {path.name}", delay=2.0, leave=False)


def write_usd(subject: Subject, path: Path) -> None:
    """Write a stage with one ``Points`` prim, /Body/Particles: positions [m] and velocities [m/s] at every frame.

    Y is up, a unit is a metre, and time codes are video frames. Points are as wide as the cubes that they fill at frame
    0, and their colours (linear light) reach a UsdPreviewSurface by a primvar. The identified parameters [SI units] are
    custom data of the layer.
    """
    from pxr import Gf, Usd, UsdGeom, Vt

    motion, state, frame_rate = subject.motion, subject.stage.state, subject.run.physics.frame_rate
    width = state.spacing / 2
    with whole_file(path) as part:
        stage = Usd.Stage.CreateNew(str(part))
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        codes = (motion.times * frame_rate).round(6).tolist()
        stage.SetTimeCodesPerSecond(frame_rate)
        stage.SetFramesPerSecond(frame_rate)
        stage.SetStartTimeCode(codes[0])
        stage.SetEndTimeCode(codes[-1])
        stage.GetRootLayer().customLayerData = {"identified_SI": state.physics}
        body = UsdGeom.Xform.Define(stage, "/Body").GetPrim()
        stage.SetDefaultPrim(body)
        points = UsdGeom.Points.Define(stage, "/Body/Particles")
        points.CreateIdsAttr(Vt.Int64Array.FromNumpy(motion.numbers))
        points.CreateWidthsAttr(Vt.FloatArray([width]))
        points.SetWidthsInterpolation(UsdGeom.Tokens.constant)
        colour = points.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex)
        colour.Set(Vt.Vec3fArray.FromNumpy(linear_light(motion.colours)))
        _bind_material(stage, points.GetPrim())
        reach = np.float32(width / 2)
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
