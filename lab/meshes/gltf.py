"""glTF 2.0 files -> Asset; pygltflib parses the file, this module decodes what it points to.

Section names refer to the glTF 2.0 specification (Khronos, registry.khronos.org/glTF/specs/2.0).
Not read, because nothing here needs it: cameras, lights, normal and emissive maps, samplers' wrap modes,
and `node.weights` (pygltflib drops it; the mesh's weights and the animation's are used).
"""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pygltflib
from PIL import Image

from dfcgs_codec.array_types import AnyArray, Float64, Int64, UInt8
from dfcgs_codec.errors import InputError
from lab.meshes.asset import Asset, Channel, Clip, Material, Node, Primitive, Skin

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
ITEM_SIZES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
#: anything else in `extensionsRequired` changes how the geometry is stored, and is refused
SUPPORTED_EXTENSIONS = frozenset({"KHR_mesh_quantization", "KHR_materials_unlit"})


@lru_cache(maxsize=4)
def load_asset(path: Path | str) -> Asset:
    """Read a .gltf or .glb file.

    Cached, because pygltflib needs seconds where a file holds thousands of animation channels.

    Raises InputError for required extensions that are not supported (Draco, meshopt, ...) and for
    assets without triangles.
    """
    document = pygltflib.GLTF2().load(str(path))
    if document is None:
        raise InputError(f"{path}: not a readable glTF 2.0 file")
    unsupported = sorted(set(document.extensionsRequired or ()) - SUPPORTED_EXTENSIONS)
    if unsupported:
        raise InputError(f"{path}: needs {', '.join(unsupported)}; export it again without these extensions")
    return _Reader(document, Path(path)).asset()


class _Reader:
    """Decodes accessors, images and the node tree of one document."""

    def __init__(self, document: pygltflib.GLTF2, path: Path) -> None:
        self.document = document
        self.path = path
        blob = document.binary_blob() or b""
        self.buffers = [blob if b.uri is None else self.uri_bytes(b.uri) for b in document.buffers]
        self.materials = [self.material(m) for m in document.materials]

    def asset(self) -> Asset:
        document = self.document
        parents = {child: i for i, n in enumerate(document.nodes) for child in n.children or ()}
        nodes = tuple(_node(n, parents.get(i, -1)) for i, n in enumerate(document.nodes))
        order = tuple(self.reachable())
        primitives = tuple(p for i in order for p in self.primitives(i))
        if not primitives:
            raise InputError(f"{self.path}: no triangles in the default scene")
        skins = tuple(self.skin(s) for s in document.skins)
        clips = tuple(self.clip(a, i) for i, a in enumerate(document.animations))
        return Asset(nodes, order, primitives, skins, clips)

    def reachable(self) -> Iterator[int]:
        """Nodes of the default scene, parents first."""
        stack = list(reversed(self.document.scenes[self.document.scene or 0].nodes))
        while stack:
            node = stack.pop()
            yield node
            stack.extend(reversed(self.document.nodes[node].children or ()))

    def uri_bytes(self, uri: str) -> bytes:
        if uri.startswith("data:"):  # pygltflib decodes only one of the legal media types
            return base64.b64decode(uri.split(",", 1)[1])
        return (self.path.parent / unquote(uri)).read_bytes()

    def view(self, index: int) -> tuple[bytes, int | None]:
        v = self.document.bufferViews[index]
        start = v.byteOffset or 0
        return self.buffers[v.buffer][start : start + v.byteLength], v.byteStride

    def accessor(self, index: int) -> AnyArray:
        """(count, components), integers kept unless normalised; sparse substitution applied."""
        a = self.document.accessors[index]
        dtype, width = np.dtype(COMPONENTS[a.componentType]), ITEM_SIZES[a.type]
        values = np.zeros((a.count, width), dtype)
        if a.bufferView is not None:
            data, stride = self.view(a.bufferView)
            strides = (stride or width * dtype.itemsize, dtype.itemsize)
            values[:] = np.ndarray((a.count, width), dtype, data, a.byteOffset or 0, strides)
        if a.sparse is not None:
            self.substitute(values, a.sparse)
        if a.normalized:
            return np.maximum(values / np.iinfo(dtype).max, -1.0)
        return values

    def substitute(self, values: AnyArray, sparse: pygltflib.Sparse) -> None:
        dtype = np.dtype(COMPONENTS[sparse.indices.componentType])
        index_data, _ = self.view(sparse.indices.bufferView)
        value_data, _ = self.view(sparse.values.bufferView)
        rows = np.frombuffer(index_data, dtype, sparse.count, sparse.indices.byteOffset or 0)
        size = sparse.count * values.shape[1]
        items = np.frombuffer(value_data, values.dtype, size, sparse.values.byteOffset or 0)
        values[rows.astype(np.int64)] = items.reshape(sparse.count, -1)

    def reals(self, index: int) -> Float64:
        return self.accessor(index).astype(np.float64)

    def skin(self, skin: pygltflib.Skin) -> Skin:
        joints = np.array(skin.joints, np.int64)
        if skin.inverseBindMatrices is None:
            return Skin(joints, np.tile(np.eye(4), (len(joints), 1, 1)))
        # glTF matrices are column-major
        return Skin(joints, self.reals(skin.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1))

    def clip(self, animation: pygltflib.Animation, index: int) -> Clip:
        targeted = [c for c in animation.channels if c.target.node is not None]
        channels = tuple(self.channel(c, animation.samplers[c.sampler]) for c in targeted)
        start = min((float(c.times[0]) for c in channels), default=0.0)
        end = max((float(c.times[-1]) for c in channels), default=0.0)
        return Clip(animation.name or str(index), channels, start, end)

    def channel(self, channel: pygltflib.AnimationChannel, sampler: pygltflib.AnimationSampler) -> Channel:
        times = self.reals(sampler.input)[:, 0]
        interpolation = sampler.interpolation or "LINEAR"
        shape = (len(times), 3, -1) if interpolation == "CUBICSPLINE" else (len(times), -1)
        values = self.reals(sampler.output).reshape(shape)
        return Channel(channel.target.node, channel.target.path, interpolation, times, values)

    def material(self, material: pygltflib.Material) -> Material:
        pbr = material.pbrMetallicRoughness or pygltflib.PbrMetallicRoughness()
        texture = None
        if pbr.baseColorTexture is not None:
            source = self.document.textures[pbr.baseColorTexture.index].source
            texture = None if source is None else self.image(self.document.images[source])
        factor = np.array(pbr.baseColorFactor or [1.0] * 4, np.float64)
        return Material(factor, texture, (material.alphaMode or "OPAQUE") != "OPAQUE")

    def image(self, image: pygltflib.Image) -> UInt8:
        data = self.view(image.bufferView)[0] if image.bufferView is not None else self.uri_bytes(image.uri)
        return np.asarray(Image.open(io.BytesIO(data)).convert("RGBA"))

    def primitives(self, index: int) -> Iterator[Primitive]:
        node = self.document.nodes[index]
        if node.mesh is None:
            return
        mesh = self.document.meshes[node.mesh]
        for primitive in mesh.primitives:
            mode = 4 if primitive.mode is None else primitive.mode
            if mode in (4, 5, 6):
                yield self.primitive(index, primitive, np.array(mesh.weights or [], np.float64))

    def primitive(self, index: int, primitive: pygltflib.Primitive, weights: Float64) -> Primitive:
        attributes = {k: v for k, v in vars(primitive.attributes).items() if v is not None}
        vertices = self.reals(attributes["POSITION"])
        count = len(vertices)
        corners = np.arange(count) if primitive.indices is None else self.accessor(primitive.indices)[:, 0]
        joints, joint_weights = self.skinning(attributes, count)
        morph = self.morph(primitive, count)
        material = Material(np.ones(4), None, False)
        if primitive.material is not None:
            material = self.materials[primitive.material]
        return Primitive(
            node=index,
            skin=self.document.nodes[index].skin if joints.shape[1] else None,
            faces=_triangles(corners.astype(np.int64), 4 if primitive.mode is None else primitive.mode),
            vertices=vertices,
            morph=morph,
            morph_weights=np.resize(weights, len(morph)) if len(weights) else np.zeros(len(morph)),
            joints=joints,
            joint_weights=joint_weights,
            uv=self.texture_coordinates(primitive, attributes),
            colors=self.colors(attributes, count),
            material=material,
        )

    def skinning(self, attributes: dict[str, int], count: int) -> tuple[Int64, Float64]:
        sets = [k for k in range(len(attributes)) if {f"JOINTS_{k}", f"WEIGHTS_{k}"} <= attributes.keys()]
        if not sets:
            return np.zeros((count, 0), np.int64), np.zeros((count, 0))
        joints = np.concatenate([self.accessor(attributes[f"JOINTS_{k}"]) for k in sets], axis=1)
        weights = np.concatenate([self.reals(attributes[f"WEIGHTS_{k}"]) for k in sets], axis=1)
        return joints.astype(np.int64), weights / np.maximum(weights.sum(1, keepdims=True), 1e-9)

    def morph(self, primitive: pygltflib.Primitive, count: int) -> Float64:
        offsets = []
        for target in primitive.targets or ():
            entry = target if isinstance(target, dict) else vars(target)
            position = entry.get("POSITION")
            offsets.append(np.zeros((count, 3)) if position is None else self.reals(position))
        return np.stack(offsets) if offsets else np.zeros((0, count, 3))

    def texture_coordinates(
        self, primitive: pygltflib.Primitive, attributes: dict[str, int]
    ) -> Float64 | None:
        texture = None
        if primitive.material is not None:
            pbr = self.document.materials[primitive.material].pbrMetallicRoughness
            texture = pbr.baseColorTexture if pbr is not None else None
        name = f"TEXCOORD_{(texture.texCoord or 0) if texture is not None else 0}"
        return self.reals(attributes[name]) if name in attributes else None

    def colors(self, attributes: dict[str, int], count: int) -> Float64:
        rgba = np.ones((count, 4))
        if "COLOR_0" in attributes:
            values = self.reals(attributes["COLOR_0"])
            rgba[:, : values.shape[1]] = values
        return rgba


def _node(node: pygltflib.Node, parent: int) -> Node:
    matrix = None if node.matrix is None else np.array(node.matrix, np.float64).reshape(4, 4).T
    return Node(
        parent,
        matrix,
        np.array(node.translation or [0.0, 0.0, 0.0], np.float64),
        np.array(node.rotation or [0.0, 0.0, 0.0, 1.0], np.float64),
        np.array(node.scale or [1.0, 1.0, 1.0], np.float64),
    )


def _triangles(corners: Int64, mode: int) -> Int64:
    """Triangle list (4), strip (5) or fan (6) -> (F, 3); section "Meshes, topology types"."""
    if mode == 4:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    if mode == 5:
        strip = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
        strip[1::2] = strip[1::2, [1, 0, 2]]
        return strip
    first = np.full(len(corners) - 2, corners[0])
    return np.stack([first, corners[1:-1], corners[2:]], axis=1)
