// SPDX-License-Identifier: Apache-2.0
// Reads the triangles of a .glb. Nodes are not looked at: those of gemsplat move nothing.

const JSON_CHUNK = 0x4e4f534a;
const ARRAYS = {5121: Uint8Array, 5123: Uint16Array, 5125: Uint32Array, 5126: Float32Array};
const WIDTHS = {SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4};
const TRIANGLES = 4;

/// Each primitive of triangles: {attributes: {POSITION: {rows, width, normalized}, ...}, indices (as
/// an attribute, or null), image (ImageBitmap of its colors, or null)}.
export async function readGlb(bytes) {
  const head = new DataView(bytes);
  if (bytes.byteLength < 28 || head.getUint32(16, true) !== JSON_CHUNK)
    throw new Error('The mesh is no .glb.');
  const length = head.getUint32(12, true),
    first = 28 + length;
  const json = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 20, length)));
  const view = index => {
    const {byteOffset = 0, byteLength} = json.bufferViews[index];
    return new Uint8Array(bytes, first + byteOffset, byteLength);
  };
  const rowsOf = index => {
    const {
      bufferView,
      byteOffset = 0,
      componentType,
      count,
      type,
      normalized,
    } = json.accessors[index];
    const Rows = ARRAYS[componentType],
      width = WIDTHS[type];
    if (!Rows || !width || json.bufferViews[bufferView].byteStride)
      throw new Error('The mesh has numbers of a kind that this page does not read.');
    const {buffer, byteOffset: start} = view(bufferView);
    return {
      rows: new Rows(buffer, start + byteOffset, count * width),
      width,
      normalized: Boolean(normalized),
    };
  };
  const imageOf = async material => {
    const use = json.materials?.[material]?.pbrMetallicRoughness?.baseColorTexture;
    if (!use) return null;
    const {bufferView, mimeType} = json.images[json.textures[use.index].source];
    return createImageBitmap(new Blob([view(bufferView)], {type: mimeType}));
  };
  const primitives = json.meshes
    .flatMap(mesh => mesh.primitives)
    .filter(({mode = TRIANGLES}) => mode === TRIANGLES);
  return Promise.all(
    primitives.map(async ({attributes, indices, material}) => ({
      attributes: Object.fromEntries(
        Object.entries(attributes).map(([name, index]) => [name, rowsOf(index)]),
      ),
      indices: indices === undefined ? null : rowsOf(indices),
      image: await imageOf(material),
    })),
  );
}
