"""Mesh files: order, polygons and texture survive; untouched points are bit-identical."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.files.mesh_files import MeshFileError, losses, read_mesh, write_mesh
from dtrepair.files.polygon_mesh import polygon_mesh, vertex_normals
from tests.present import present

# Two quads, a triangle and a pentagon over seven vertices; digits that float32 cannot hold exactly.
OBJ = """# made by hand
mtllib paint.mtl
o Thing
v 0.1 0 0 0.5 0.5 0.5
v 1.1 0 0
v 1.1 1 0.3333333333333333
v 0.1 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vn 0 0 1
g left
usemtl red
s 1
f 1/1/1 2/2/1 3/3/1 4/4/1
v 2.25 0 0
v 2.25 1 0
v 1.7 1.7 0.1
f -6//1 5//1 6//1 3//1
f 3 6 7
f 4/4 3/3 7/1 6/2 1/1
"""


@pytest.fixture
def obj_path(tmp_path: Path) -> Path:
    path = tmp_path / "thing.obj"
    path.write_text(OBJ)
    return path


def quads_and_triangles() -> tuple[NDArray[np.float64], list[list[int]]]:
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0.1], [2, 1, 0.1]]
    return np.array(points), [[0, 1, 2, 3], [1, 4, 5, 2], [0, 3, 5]]


def moved(points: NDArray[np.float64]) -> NDArray[np.float64]:
    result = np.array(points)
    result[2] += (0.01, -0.02, 1 / 3)
    return result


def test_obj_keeps_vertex_order_polygons_and_texture(obj_path: Path) -> None:
    mesh = read_mesh(obj_path)
    assert mesh.points[0].tolist() == [0.1, 0.0, 0.0]
    assert mesh.points[6].tolist() == [1.7, 1.7, 0.1]
    assert mesh.counts.tolist() == [4, 4, 3, 5]
    assert mesh.corners[:8].tolist() == [0, 1, 2, 3, 1, 4, 5, 2]
    assert present(mesh.texture).tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]
    assert present(mesh.texture_corners)[:8].tolist() == [0, 1, 2, 3, -1, -1, -1, -1]
    assert present(mesh.texture_corners)[-5:].tolist() == [3, 2, 0, 1, 0]


def test_faces_are_fans_in_polygon_order(obj_path: Path) -> None:
    faces = read_mesh(obj_path).faces()
    assert faces.dtype == np.int32
    assert faces.tolist() == [
        [0, 1, 2], [0, 2, 3],
        [1, 4, 5], [1, 5, 2],
        [2, 5, 6],
        [3, 2, 6], [3, 6, 5], [3, 5, 0],
    ]  # fmt: skip


def test_untouched_obj_is_byte_identical(obj_path: Path, tmp_path: Path) -> None:
    mesh = read_mesh(obj_path)
    # What comes back from a repair went through float32.
    write_mesh(tmp_path / "out.obj", mesh, mesh.points.astype(np.float32))
    assert (tmp_path / "out.obj").read_bytes() == obj_path.read_bytes()


def test_moved_obj_changes_only_the_moved_vertex_and_drops_normals(
    obj_path: Path, tmp_path: Path
) -> None:
    mesh = read_mesh(obj_path)
    points = moved(mesh.points)
    write_mesh(tmp_path / "out.obj", mesh, points)
    old, new = OBJ.splitlines(), (tmp_path / "out.obj").read_text().splitlines()
    assert [line for line in old if line.startswith(("#", "g", "usemtl", "s", "o", "mtllib"))] == [
        line for line in new if line.startswith(("#", "g", "usemtl", "s", "o", "mtllib"))
    ]
    vertices = [[line for line in text if line.startswith("v ")] for text in (old, new)]
    assert [a == b for a, b in zip(*vertices, strict=True)] == [True, True, False, *[True] * 4]
    assert not [line for line in new if line.startswith("vn")]
    assert "f 1/1 2/2 3/3 4/4" in new and "f -6 5 6 3" in new
    back = read_mesh(tmp_path / "out.obj")
    assert np.array_equal(back.points.astype(np.float32), points.astype(np.float32))
    assert np.array_equal(back.corners, mesh.corners)
    assert np.array_equal(present(back.texture_corners), present(mesh.texture_corners))


@pytest.mark.parametrize("format", ["obj", "ply", "off"])
def test_polygons_survive_between_formats(obj_path: Path, tmp_path: Path, format: str) -> None:
    mesh = read_mesh(obj_path)
    write_mesh(tmp_path / f"out.{format}", mesh, mesh.points)
    back = read_mesh(tmp_path / f"out.{format}")
    assert back.counts.tolist() == mesh.counts.tolist()
    assert back.corners.tolist() == mesh.corners.tolist()
    assert np.array_equal(back.points.astype(np.float32), mesh.points.astype(np.float32))


@pytest.mark.parametrize("format", ["ply", "off", "glb", "stl"])
def test_second_writing_in_the_same_format(tmp_path: Path, format: str) -> None:
    points, polygons = quads_and_triangles()
    source = polygon_mesh("none", points, polygons)
    first, second, third = (tmp_path / f"{n}.{format}" for n in "abc")
    write_mesh(first, source, points)
    mesh = read_mesh(first)
    write_mesh(second, mesh, mesh.points)
    again = read_mesh(second)
    assert np.array_equal(again.points, mesh.points)
    assert np.array_equal(again.corners, mesh.corners)
    assert mesh.points[mesh.faces()].astype(np.float32) == pytest.approx(points[source.faces()])
    if format in ("ply", "off"):
        assert second.read_bytes() == first.read_bytes()
        assert again.counts.tolist() == [4, 4, 3]
    changed = moved(mesh.points)
    write_mesh(third, mesh, changed)
    assert np.array_equal(
        read_mesh(third).points[read_mesh(third).faces()].astype(np.float32),
        changed[mesh.faces()].astype(np.float32),
    )


def test_stl_joins_equal_positions(tmp_path: Path) -> None:
    points, polygons = quads_and_triangles()
    write_mesh(tmp_path / "a.stl", polygon_mesh("none", points, polygons), points)
    assert len(read_mesh(tmp_path / "a.stl").points) == 6


def make_ply(order: str) -> bytes:
    points, polygons = quads_and_triangles()
    normals = vertex_normals(points, polygon_mesh("none", points, polygons).faces())
    names = ("x", "y", "z", "nx", "ny", "nz", "s", "t")
    rows = np.zeros(6, dtype=[*((name, order + "f4") for name in names), ("red", "u1")])
    for column, name in enumerate(("x", "y", "z")):
        rows[name], rows["n" + name] = points[:, column], normals[:, column]
    rows["s"], rows["t"], rows["red"] = points[:, 0] / 2, points[:, 1], np.arange(6)
    faces = [[*b, 7] for b in polygons]
    kind = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order]
    header = ["ply", f"format {kind} 1.0", "comment kept", "element vertex 6"]
    header += [f"property float {name}" for name in present(rows.dtype.names)[:8]]
    header += ["property uchar red", "element face 3", "property list uchar int vertex_indices"]
    header += ["property short flags", "element edge 1", "property int vertex1", "end_header", ""]
    body = b""
    if order:
        body += rows.tobytes()
        for face in faces:
            body += bytes([len(face) - 1]) + np.array(face[:-1], order + "i4").tobytes()
            body += np.array(face[-1:], order + "i2").tobytes()
        body += np.array([5], order + "i4").tobytes()
    else:
        lines = [" ".join(str(value) for value in row) for row in rows]
        lines += [" ".join(map(str, [len(face) - 1, *face])) for face in faces] + ["5", ""]
        body = "\n".join(lines).encode()
    return "\n".join(header).encode() + body


@pytest.mark.parametrize("order", ["", "<", ">"])
def test_ply_keeps_its_other_properties(tmp_path: Path, order: str) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(make_ply(order))
    mesh = read_mesh(path)
    assert mesh.counts.tolist() == [4, 4, 3]
    assert mesh.corners.tolist() == [0, 1, 2, 3, 1, 4, 5, 2, 0, 3, 5]
    assert np.allclose(present(mesh.texture), mesh.points[:, :2] / (2, 1))
    write_mesh(tmp_path / "b.ply", mesh, mesh.points)
    assert (tmp_path / "b.ply").read_bytes() == path.read_bytes()
    points = moved(mesh.points)
    write_mesh(tmp_path / "c.ply", mesh, points)
    back = read_mesh(tmp_path / "c.ply")
    assert np.array_equal(back.points.astype(np.float32), points.astype(np.float32))
    assert np.array_equal(present(back.texture), present(mesh.texture))
    assert np.array_equal(back.corners, mesh.corners)
    rows = back.original.vertices
    assert rows["red"].tolist() == list(range(6))
    written = np.stack([rows[n] for n in ("nx", "ny", "nz")], axis=1)
    assert np.allclose(written, vertex_normals(points, mesh.faces()), atol=1e-6)
    assert b"comment kept" in (tmp_path / "c.ply").read_bytes()


def test_texture_of_shared_vertices_survives_ply_to_obj_and_glb(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_bytes(make_ply("<"))
    mesh = read_mesh(tmp_path / "a.ply")
    write_mesh(tmp_path / "a.obj", mesh, mesh.points)
    back = read_mesh(tmp_path / "a.obj")
    texture = present(mesh.texture)
    textured = present(back.texture)[present(back.texture_corners)]
    assert np.allclose(textured, texture[mesh.corners], atol=1e-6)
    write_mesh(tmp_path / "a.glb", mesh, mesh.points)
    assert np.allclose(present(read_mesh(tmp_path / "a.glb").texture), texture, atol=1e-6)


def test_losses_name_what_a_format_drops(obj_path: Path, tmp_path: Path) -> None:
    mesh = read_mesh(obj_path)
    assert losses(mesh, "obj") == ()
    assert losses(mesh, "ply") == ("texture coordinates are dropped",)
    assert losses(mesh, "stl")[0] == "polygons become triangles"
    assert "vertices are no longer shared" in losses(mesh, "stl")
    write_mesh(tmp_path / "a.stl", mesh, mesh.points)
    assert losses(read_mesh(tmp_path / "a.stl"), "stl") == ()


def test_vertex_normals_of_a_square() -> None:
    points = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [9, 9, 9]])
    normals = vertex_normals(points, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32))
    assert normals[:4].tolist() == [[0, 0, 1]] * 4
    assert normals[4].tolist() == [0, 0, 0]  # unused


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.obj", "v 0 0\n", r"a\.obj: line 1: expected 3 numbers, got 2"),
        ("a.obj", "v 0 0 nan\n", "line 1: expected finite"),
        ("a.obj", "v 0 0 0\nf 1 2 3\n", "line 2: expected vertex indices up to 1 .* got 3"),
        ("a.obj", "v 0 0 0\nf 0 1 1\n", "line 2: expected an index from 1"),
        ("a.obj", "v 0 0 0\nf 00 1 1\nv 0 0 0\n", "line 2: expected an index from 1"),
        ("a.obj", "v 0 0 0\nf 1/0 1/1 1/1\n", "line 2: expected an index from 1"),
        ("a.obj", "v 0 0 0\nf 1 1 \\\n1\n", "line 2: a line continued"),
        ("a.obj", "v 0 0 0\n", "expected a mesh with faces"),
        ("a.obj", "", "the file is empty .*; export it again"),
        ("a.glb", "", "the file is empty"),
        ("a.stl", "hello \x01 garbage\n" * 30, "not a readable stl file: .*; mend the file or"),
        ("a.ply", "ply\nformat", "not a readable PLY"),
        ("a.ply", "ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\n"
         "property float y\nproperty float z\nend_header\n", "ends early"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n", "ends early"),
        ("a.off", "PLY\n", "expected a first line OFF"),
        ("a.stl", "nonsense", "not a readable stl"),
        ("a.glb", "nonsense", "not a readable glb"),
        ("a.xyzzy", "x", "expected a mesh format such as obj"),
        ("a", "", "expected a file extension"),
    ],
)  # fmt: skip
def test_unreadable_files_are_refused(
    tmp_path: Path, name: str, content: str, message: str
) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(MeshFileError, match=message):
        read_mesh(tmp_path / name)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(MeshFileError, match="No such file"):
        read_mesh(tmp_path / "none.obj")


def test_several_meshes_are_refused(tmp_path: Path) -> None:
    import trimesh

    scene = trimesh.Scene([trimesh.creation.box(), trimesh.creation.box()])
    (tmp_path / "two.glb").write_bytes(scene.export(file_type="glb"))
    with pytest.raises(MeshFileError, match="expected one mesh in the file, got 2"):
        read_mesh(tmp_path / "two.glb")


def test_bad_points_and_formats_write_nothing(obj_path: Path, tmp_path: Path) -> None:
    mesh = read_mesh(obj_path)
    before = sorted(os.listdir(tmp_path))
    with pytest.raises(ValueError, match=r"expected shape \(7, 3\)"):
        write_mesh(tmp_path / "b.obj", mesh, mesh.points[:-1])
    with pytest.raises(ValueError, match="finite"):
        write_mesh(tmp_path / "b.obj", mesh, mesh.points * np.nan)
    with pytest.raises(MeshFileError, match="to write, got dae"):
        write_mesh(tmp_path / "b.dae", mesh, mesh.points)
    with pytest.raises(OSError):
        write_mesh(tmp_path / "none" / "b.obj", mesh, mesh.points)
    assert sorted(os.listdir(tmp_path)) == before


def test_shared_human_round_trip(shared_data: Path, tmp_path: Path) -> None:
    path = shared_data / "humans" / "human_male_rest.obj"
    mesh = read_mesh(path)
    assert (len(mesh.points), len(mesh.counts), len(mesh.faces())) == (13380, 13378, 26756)
    write_mesh(tmp_path / "out.obj", mesh, mesh.points.astype(np.float32))
    assert (tmp_path / "out.obj").read_bytes() == path.read_bytes()
