// The turntable with its sensors in their geometry, turned by the encoders and by the attitude.

import * as THREE from "./carried/three.module.min.js";
import { $, colour } from "./parts.js";

const RAD = Math.PI / 180;
const REACH = 1.0; // from the centre to a gyro
const FIRST_VIEW = { azimuth: -0.95, elevation: 0.42, distance: 8.1 };

const direction = ([polar, azimuth]) =>
  new THREE.Vector3(Math.sin(polar * RAD) * Math.cos(azimuth * RAD), Math.sin(polar * RAD) * Math.sin(azimuth * RAD), Math.cos(polar * RAD));

function label(text, ink, size = 0.3) {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 96;
  const ctx = canvas.getContext("2d");
  ctx.font = "600 54px system-ui, sans-serif";
  ctx.textAlign = "center";
  ctx.textBaseline = "middle";
  ctx.lineWidth = 9;
  ctx.strokeStyle = colour("sky");
  ctx.strokeText(text, 48, 50);
  ctx.fillStyle = ink;
  ctx.fillText(text, 48, 50);
  const sprite = new THREE.Sprite(new THREE.SpriteMaterial({ map: new THREE.CanvasTexture(canvas), depthTest: false }));
  sprite.scale.set(size, size, 1);
  return sprite;
}

function rod(from, to, radius, material) {
  const along = to.clone().sub(from);
  const mesh = new THREE.Mesh(new THREE.CylinderGeometry(radius, radius, along.length(), 14), material);
  mesh.position.copy(from).addScaledVector(along, 0.5);
  mesh.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), along.normalize());
  return mesh;
}

function triad(reach, names, inks) {
  const group = new THREE.Group();
  [[1, 0, 0], [0, 1, 0], [0, 0, 1]].forEach((axis, k) => {
    const way = new THREE.Vector3(...axis);
    group.add(new THREE.ArrowHelper(way, new THREE.Vector3(), reach, new THREE.Color(inks[k]), 0.16, 0.08));
    const text = label(names[k], inks[k], 0.27);
    text.position.copy(way).multiplyScalar(reach + 0.14);
    group.add(text);
  });
  return group;
}

export class Scene {
  constructor() {
    this.canvas = $("scene");
    this.view = { ...FIRST_VIEW };
    this.pose = { inner: 0, outer: 0, roll: 0, pitch: 0, heading: 0 };
    this.axes = { gyros: [], accelerometers: [] };
    this.states = { gyros: [], accelerometers: [] };
    try {
      this.renderer = new THREE.WebGLRenderer({ canvas: this.canvas, antialias: true });
    } catch {
      $("scene-note").textContent = "No WebGL here: the turntable cannot be drawn.";
      return;
    }
    this.camera = new THREE.PerspectiveCamera(32, 1, 0.1, 60);
    this.camera.up.set(0, 0, 1);
    this.build();
    this.listen();
    new ResizeObserver(() => this.resize()).observe(this.canvas.parentElement);
  }

  build() {
    if (!this.renderer) return;
    const metal = new THREE.MeshStandardMaterial({ color: colour("metal"), metalness: 0.35, roughness: 0.55 });
    const dark = new THREE.MeshStandardMaterial({ color: colour("metal-dark"), metalness: 0.35, roughness: 0.6 });
    const scene = (this.scene = new THREE.Scene());
    scene.background = new THREE.Color(colour("sky"));
    scene.add(new THREE.HemisphereLight(0xffffff, new THREE.Color(colour("ground")), 2.1));
    const sun = new THREE.DirectionalLight(0xffffff, 1.7);
    sun.position.set(3, -4, 6);
    scene.add(sun);
    const grid = new THREE.GridHelper(8, 16, colour("line"), colour("line"));
    grid.rotation.x = Math.PI / 2;
    grid.position.z = -1.75;
    scene.add(grid);
    const world = triad(0.75, ["E", "N", "U"], [colour("east"), colour("north"), colour("soft")]);
    world.position.set(-1.3, -2.1, -1.72);
    scene.add(world);
    this.body = new THREE.Group();
    scene.add(this.body);
    this.addStand(metal, dark);
    this.outer = new THREE.Group();
    this.body.add(this.outer);
    this.addGimbal(metal, dark);
    this.inner = new THREE.Group();
    this.outer.add(this.inner);
    this.addSensors(dark);
    this.turn();
  }

  // The base and two pillars that hold the outer axis, x of the body.
  addStand(metal, dark) {
    const base = new THREE.Mesh(new THREE.BoxGeometry(3.7, 1.7, 0.14), dark);
    base.position.z = -1.66;
    this.body.add(base);
    for (const side of [-1, 1]) {
      const pillar = new THREE.Mesh(new THREE.BoxGeometry(0.16, 0.62, 1.75), metal);
      pillar.position.set(side * 1.72, 0, -0.78);
      this.body.add(pillar, rod(new THREE.Vector3(side * 1.45, 0, 0), new THREE.Vector3(side * 1.9, 0, 0), 0.17, dark));
    }
    const frame = triad(0.62, ["x", "y", "z"], [colour("soft"), colour("accent"), colour("soft")]);
    frame.position.set(1.72, -0.0, 0.32);
    this.body.add(frame);
  }

  // The ring of the outer axis, with the bearings of the inner axis, z of the sensors.
  addGimbal(metal, dark) {
    const ring = new THREE.Mesh(new THREE.TorusGeometry(1.38, 0.075, 12, 72), metal);
    ring.rotation.x = Math.PI / 2;
    this.outer.add(ring);
    for (const side of [-1, 1])
      this.outer.add(rod(new THREE.Vector3(0, 0, side * 1.18), new THREE.Vector3(0, 0, side * 1.5), 0.12, dark));
    const arrow = new THREE.Mesh(new THREE.ConeGeometry(0.09, 0.22, 16), new THREE.MeshStandardMaterial({ color: colour("accent") }));
    arrow.rotation.x = Math.PI / 2;
    arrow.position.z = 1.62;
    this.outer.add(arrow);
  }

  addSensors(dark) {
    this.marks = { gyros: [], accelerometers: [] };
    const disc = new THREE.Mesh(new THREE.CylinderGeometry(0.42, 0.42, 0.05, 48), dark);
    disc.rotation.x = Math.PI / 2;
    disc.position.z = -1.12;
    this.inner.add(disc, rod(new THREE.Vector3(0, 0, -1.15), new THREE.Vector3(0, 0, 1.15), 0.022, dark));
    const mark = new THREE.Mesh(new THREE.BoxGeometry(0.2, 0.05, 0.07), new THREE.MeshStandardMaterial({ color: colour("north") }));
    mark.position.set(0.36, 0, -1.08);
    this.inner.add(mark);
    const ends = this.axes.gyros.map((axis) => direction(axis).multiplyScalar(REACH * 0.94));
    if (ends.length === 4) this.addFaces(ends);
    for (const [kind, reach, letter] of [["gyros", REACH * 0.94, "G"], ["accelerometers", REACH * 0.6, "A"]])
      this.axes[kind].forEach((axis, k) => this.addSensor(kind, k, direction(axis), reach, letter));
    this.restate();
  }

  // Four directions span a tetrahedron: its edges, and faces that one can look through.
  addFaces(ends) {
    const points = [];
    const faces = [];
    for (let a = 0; a < 4; a++)
      for (let b = a + 1; b < 4; b++) {
        points.push(ends[a], ends[b]);
        for (let c = b + 1; c < 4; c++) faces.push(...ends[a].toArray(), ...ends[b].toArray(), ...ends[c].toArray());
      }
    const edges = new THREE.BufferGeometry().setFromPoints(points);
    this.inner.add(new THREE.LineSegments(edges, new THREE.LineBasicMaterial({ color: colour("accent") })));
    const solid = new THREE.BufferGeometry();
    solid.setAttribute("position", new THREE.Float32BufferAttribute(faces, 3));
    this.inner.add(new THREE.Mesh(solid, new THREE.MeshBasicMaterial({ color: colour("accent"), transparent: true, opacity: 0.09, side: THREE.DoubleSide, depthWrite: false })));
  }

  addSensor(kind, number, way, reach, letter) {
    const shape = kind === "gyros" ? new THREE.CylinderGeometry(0.15, 0.15, 0.16, 26) : new THREE.BoxGeometry(0.19, 0.19, 0.19);
    const mesh = new THREE.Mesh(shape, new THREE.MeshStandardMaterial({ roughness: 0.5 }));
    mesh.position.copy(way).multiplyScalar(reach);
    mesh.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), way);
    const text = label(`${letter}${number + 1}`, colour("text"), 0.27);
    text.position.copy(way).multiplyScalar(reach + (kind === "gyros" ? 0.22 : 0));
    if (kind === "accelerometers") text.position.add(new THREE.Vector3(way.y, -way.x, 0).normalize().multiplyScalar(0.22));
    const cross = label("✕", colour("excluded"), 0.46);
    cross.position.copy(mesh.position);
    cross.visible = false;
    this.inner.add(mesh, text, cross);
    if (kind === "gyros") this.inner.add(rod(new THREE.Vector3(), mesh.position.clone(), 0.016, new THREE.MeshStandardMaterial({ color: colour("metal-dark") })));
    this.marks[kind].push({ mesh, cross });
  }

  restate() {
    if (!this.renderer) return;
    for (const kind of ["gyros", "accelerometers"])
      this.marks[kind].forEach(({ mesh, cross }, k) => {
        const state = this.states[kind][k] ?? "absent";
        mesh.material.color.set(colour(state === "saturated" ? "suspect" : state));
        mesh.material.wireframe = state === "absent";
        cross.visible = state === "excluded";
        mesh.scale.setScalar(state === "suspect" ? 1.3 : 1);
      });
    this.isDirty = true;
  }

  setGeometry(axes) {
    this.axes = axes;
    this.build();
  }

  setStates(states) {
    if (JSON.stringify(states) === JSON.stringify(this.states)) return;
    this.states = states;
    this.restate();
  }

  setPose(pose) {
    this.pose = pose;
    this.turn();
  }

  turn() {
    if (!this.renderer) return;
    const { inner, outer, roll, pitch, heading } = this.pose;
    this.body.rotation.set((pitch || 0) * RAD, (roll || 0) * RAD, -(heading || 0) * RAD, "ZXY");
    this.outer.rotation.x = (outer || 0) * RAD;
    this.inner.rotation.z = (inner || 0) * RAD;
    this.isDirty = true;
  }

  listen() {
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      this.dragged = [event.clientX, event.clientY];
    });
    this.canvas.addEventListener("pointermove", (event) => {
      if (!this.dragged) return;
      this.view.azimuth -= (event.clientX - this.dragged[0]) * 0.008;
      this.view.elevation = Math.min(1.5, Math.max(-0.4, this.view.elevation + (event.clientY - this.dragged[1]) * 0.008));
      this.dragged = [event.clientX, event.clientY];
      this.isDirty = true;
    });
    this.canvas.addEventListener("pointerup", () => (this.dragged = null));
    this.canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.view.distance = Math.min(14, Math.max(3, this.view.distance * Math.exp(event.deltaY * 0.001)));
      this.isDirty = true;
    }, { passive: false });
  }

  resetView() {
    this.view = { ...FIRST_VIEW };
    this.isDirty = true;
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    if (!width || !height) return;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.isDirty = true;
  }

  draw() {
    if (!this.renderer || !this.isDirty) return;
    this.isDirty = false;
    const { azimuth, elevation, distance } = this.view;
    const far = distance * Math.max(1, 1.25 / this.camera.aspect);
    this.camera.position.set(far * Math.cos(elevation) * Math.cos(azimuth), far * Math.cos(elevation) * Math.sin(azimuth), far * Math.sin(elevation) - 0.3);
    this.camera.lookAt(0, 0, -0.3);
    this.camera.updateProjectionMatrix();
    this.renderer.render(this.scene, this.camera);
  }
}
