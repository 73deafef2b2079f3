// The viewer of contacts: before, after, or a wipe between them, in space.
const RAMP = [[0.23, 0.29, 0.55], [0.16, 0.47, 0.56], [0.13, 0.66, 0.52], [0.48, 0.82, 0.32],
  [0.99, 0.91, 0.14]];
const RED = [0.9, 0.06, 0.05], BACK = 0x4c73d9;

// Arrays as `dtrepair.display.packing` wrote them.
async function unpack(view) {
  const octets = Uint8Array.from(atob(view.data), (letter) => letter.charCodeAt(0));
  const stream = new Blob([octets]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  const kinds = { Uint8Array, Uint16Array, Uint32Array };
  const arrays = {};
  let start = 0;
  for (const [name, kind, count] of view.arrays) {
    const array = new kinds[kind](count);
    const size = array.byteLength;
    if (kind === "Uint16Array") {
      for (let i = 0; i < count; i++) array[i] = bytes[start + i] | (bytes[start + count + i] << 8);
    } else {
      new Uint8Array(array.buffer).set(bytes.subarray(start, start + size));
    }
    arrays[name] = array;
    start += size + ((4 - (size % 4)) % 4);
  }
  return arrays;
}

// Positions of every frame and pose: differences of 16 bits, added up.
function poses(view, arrays) {
  const size = 3 * view.vertices, count = view.frames.length;
  const summed = (steps) => {
    const total = new Uint16Array(steps);
    for (let i = size; i < total.length; i++) total[i] += total[i - size];
    return total;
  };
  const first = summed(arrays.first);
  const found = [{ steps: new Int16Array(first.buffer), red: spread(arrays, "red", count) }];
  if (arrays.moved) {
    const second = summed(arrays.moved);
    const moved = new Int16Array(second.buffer.slice(0));
    for (let i = 0; i < second.length; i++) second[i] += first[i];
    found.push({ steps: new Int16Array(second.buffer), red: spread(arrays, "red_after", count),
      moved });
  }
  return found;
}

function spread(arrays, name, count) {
  const rows = [];
  let start = 0;
  for (let k = 0; k < count; k++) {
    const end = start + arrays[name + "_counts"][k];
    rows.push(arrays[name].subarray(start, end));
    start = end;
  }
  return rows;
}

function ramp(share) {
  const at = Math.min(Math.max(share, 0), 1) * (RAMP.length - 1);
  const low = Math.min(Math.floor(at), RAMP.length - 2);
  return RAMP[low].map((value, k) => value + (at - low) * (RAMP[low + 1][k] - value));
}

class Viewer {
  constructor(stage, palette, changed) {
    this.stage = stage;
    this.palette = palette;
    this.changed = changed;
    this.state = { frame: 0, mode: "wipe", wipe: 0.5, colour: "objects", red: true, clear: false };
    this.renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.autoClear = false;
    stage.append(this.renderer.domElement);
    this.camera = new THREE.PerspectiveCamera(28, 1, 0.01, 100);
    this.camera.add(new THREE.DirectionalLight(0xffffff, 0.75));
    this.camera.children[0].position.set(-0.5, 0.7, 1);
    this.scene = new THREE.Scene();
    this.scene.add(this.camera, new THREE.HemisphereLight(0xffffff, 0x777788, 0.55));
    this.controls = new THREE.TrackballControls(this.camera, this.renderer.domElement);
    Object.assign(this.controls, { staticMoving: true, rotateSpeed: 3, noZoom: true, keys: [] });
    // The wheel scrolls the page until the viewer was clicked.
    stage.addEventListener("pointerdown", () => { this.controls.noZoom = false; });
    stage.addEventListener("pointerleave", () => { this.controls.noZoom = true; });
    this.controls.addEventListener("change", () => { this.dirty = true; });
    new ResizeObserver(() => this.resize()).observe(stage);
    this.resize();
    const turn = () => { this.controls.update(); if (this.dirty) this.draw();
      requestAnimationFrame(turn); };
    turn();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.stage;
    if (!width || !height) return;
    this.renderer.setSize(width, height);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.controls.handleResize();
    this.dirty = true;
  }

  // Show a contact at one of its frames, from where most of it is seen.
  async show(view, frame) {
    const arrays = await unpack(view);
    this.view = view;
    this.faces = arrays.faces;
    this.objects = arrays.objects;
    this.poses = poses(view, arrays);
    for (const mesh of this.meshes || []) {
      this.scene.remove(mesh);
      mesh.children.forEach((child) => child.material.dispose());
      mesh.children[0].geometry.dispose();
    }
    this.meshes = this.poses.map(() => this.mesh());
    this.scene.add(...this.meshes);
    this.largest = this.largestMove();
    this.set({ frame });
    this.look(true);
  }

  mesh() {
    const corners = this.faces.length;
    const geometry = new THREE.BufferGeometry();
    for (const name of ["position", "normal", "color"]) {
      geometry.setAttribute(name, new THREE.BufferAttribute(new Float32Array(3 * corners), 3));
    }
    const both = new THREE.Group();
    const front = new THREE.MeshLambertMaterial({ vertexColors: true });
    const back = new THREE.MeshLambertMaterial({ color: BACK, side: THREE.BackSide });
    for (const material of [front, back]) {
      const part = new THREE.Mesh(geometry, material);
      part.frustumCulled = false;
      both.add(part);
    }
    return both;
  }

  largestMove() {
    const moved = this.poses.length > 1 ? this.poses[1].moved : [];
    let most = 0;
    for (let i = 0; i < moved.length; i += 3) {
      most = Math.max(most, Math.hypot(moved[i], moved[i + 1], moved[i + 2]));
    }
    return most;
  }

  // The camera to the contact, or back until all of it is seen.
  look(close) {
    const { rotation, target, half, size } = this.view;
    const [, up, towards] = rotation;
    const middle = new THREE.Vector3(...target);
    const reach = close ? 1.25 * half : 0.75 * size;
    const distance = reach / Math.tan(THREE.MathUtils.degToRad(14)) /
      Math.min(this.camera.aspect, 1);
    this.camera.position.copy(middle).addScaledVector(new THREE.Vector3(...towards), distance);
    this.camera.up.set(...up);
    this.camera.near = distance / 100;
    this.camera.far = distance + 4 * size;
    this.camera.updateProjectionMatrix();
    this.controls.target.copy(middle);
    this.controls.update();
    this.dirty = true;
  }

  set(change) {
    Object.assign(this.state, change);
    if (!this.view) return;
    this.state.frame = Math.min(Math.max(this.state.frame, 0), this.view.frames.length - 1);
    this.meshes.forEach((mesh, number) => this.fill(mesh, number));
    this.dirty = true;
    this.changed(this);
  }

  // Positions, normals and colours of a pose in the current frame.
  fill(mesh, number) {
    const { faces, objects, palette, view } = this;
    const { frame, colour, red, clear } = this.state;
    const size = 3 * view.vertices, pose = this.poses[number];
    const steps = pose.steps.subarray(frame * size, (frame + 1) * size);
    const geometry = mesh.children[0].geometry;
    const attributes = ["position", "normal", "color"].map((n) => geometry.getAttribute(n));
    const [position, normal, paint] = attributes.map((attribute) => attribute.array);
    const sums = vertexNormals(steps, faces, view.vertices);
    const moved = colour === "displacement" && this.poses.length > 1 ? this.poses[1].moved : null;
    for (let corner = 0; corner < faces.length; corner++) {
      const vertex = 3 * faces[corner], at = 3 * corner;
      let tint = palette[objects[(corner / 3) | 0]];
      if (moved) {
        const [x, y, z] = moved.subarray(frame * size + vertex, frame * size + vertex + 3);
        tint = ramp(Math.hypot(x, y, z) / (this.largest || 1));
      }
      for (let k = 0; k < 3; k++) {
        position[at + k] = steps[vertex + k] * view.step;
        normal[at + k] = sums[vertex + k];
        paint[at + k] = tint[k];
      }
    }
    if (red) for (const face of pose.red[frame]) {
      for (let corner = 3 * face; corner < 3 * face + 3; corner++) paint.set(RED, 3 * corner);
    }
    attributes.forEach((attribute) => { attribute.needsUpdate = true; });
    for (const { material } of mesh.children) {
      Object.assign(material, { transparent: clear, opacity: clear ? 0.45 : 1, depthWrite: !clear });
    }
  }

  draw() {
    this.dirty = false;
    const { clientWidth: width, clientHeight: height } = this.stage;
    const paper = getComputedStyle(this.stage).backgroundColor;
    this.renderer.setClearColor(new THREE.Color(paper));
    this.renderer.setScissorTest(false);
    this.renderer.clear();
    if (!this.meshes) return;
    const two = this.meshes.length > 1;
    const edge = { before: 1, after: 0, wipe: this.state.wipe }[two ? this.state.mode : "before"];
    this.renderer.setScissorTest(true);
    this.meshes.forEach((mesh, number) => {
      const [from, to] = number === 0 ? [0, edge] : [edge, 1];
      if (to <= from) return;
      this.meshes.forEach((other) => { other.visible = other === mesh; });
      this.renderer.setScissor(from * width, 0, (to - from) * width, height);
      this.renderer.clearDepth();
      this.renderer.render(this.scene, this.camera);
    });
  }
}

// Normals of vertices, weighted by area.
function vertexNormals(steps, faces, count) {
  const sums = new Float32Array(3 * count);
  for (let i = 0; i < faces.length; i += 3) {
    const [a, b, c] = [3 * faces[i], 3 * faces[i + 1], 3 * faces[i + 2]];
    const ux = steps[b] - steps[a], uy = steps[b + 1] - steps[a + 1], uz = steps[b + 2] - steps[a + 2];
    const vx = steps[c] - steps[a], vy = steps[c + 1] - steps[a + 1], vz = steps[c + 2] - steps[a + 2];
    const n = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    for (const vertex of [a, b, c]) for (let k = 0; k < 3; k++) sums[vertex + k] += n[k];
  }
  for (let i = 0; i < sums.length; i += 3) {
    const length = Math.hypot(sums[i], sums[i + 1], sums[i + 2]) || 1;
    for (let k = 0; k < 3; k++) sums[i + k] /= length;
  }
  return sums;
}
