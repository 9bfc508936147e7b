// The cell in three dimensions, from what stands still and the angles of the joints.
import * as THREE from "./three/three.module.min.js";

const GHOST = 0.3; // of what is still to come
const COLOURS = { bracket: 0x8c949e, bin: 0xa69985, other: 0xccc4b8, robot: 0xb8bdc7, tool: 0x33383f, hand: 0xd9a066 };

export class Space {
  constructor(canvas, scene, still) {
    this.told = scene;
    this.still = still;
    this.canvas = canvas;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color(0xdfe3e8);
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x8890a0, 2.2));
    const sun = new THREE.DirectionalLight(0xffffff, 1.6);
    sun.position.set(1.5, -1, 3);
    this.scene.add(sun);
    this.camera = new THREE.PerspectiveCamera(42, 1, 0.05, 20);
    this.camera.up.set(0, 0, 1); // the world's z is up, and the person looks along -x
    this.turn = { around: 0.45, above: 0.6, away: 1.9 };
    this.frames = { base_link: new THREE.Group() };
    this.scene.add(this.frames.base_link);
    this.joints = scene.joints.map((joint) => this.joint(joint));
    this.fingers = [];
    for (const shape of scene.shapes) this.link(shape);
    this.bench();
    this.moving = new THREE.Group();
    this.scene.add(this.moving);
    this.hand = this.palm();
    this.hand.visible = false;
    this.scene.add(this.hand);
    this.drag();
    new ResizeObserver(() => this.draw()).observe(canvas.parentElement);
  }

  mesh(geometry, colour, opacity = 1) {
    const material = new THREE.MeshLambertMaterial({ color: colour, transparent: opacity < 1, opacity });
    return new THREE.Mesh(geometry, material);
  }

  place(object, [x, y, z, qx, qy, qz, qw]) {
    object.position.set(x, y, z);
    object.quaternion.set(qx, qy, qz, qw);
    return object;
  }

  joint({ parent, child, pose, axis }) {
    const frame = this.place(new THREE.Group(), pose);
    const turning = new THREE.Group();
    frame.add(turning);
    this.frames[parent].add(frame);
    this.frames[child] = turning;
    return { turning, axis: new THREE.Vector3(...axis) };
  }

  link(shape) {
    let geometry;
    if (shape.box_m) geometry = new THREE.BoxGeometry(...shape.box_m);
    else {
      geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", new THREE.Float32BufferAttribute(shape.points_m, 3));
      geometry.setIndex(shape.triangles);
      geometry = geometry.toNonIndexed();
      geometry.computeVertexNormals();
    }
    const body = this.place(this.mesh(geometry, shape.box_m ? COLOURS.tool : COLOURS.robot), shape.pose);
    body.material.side = THREE.DoubleSide;
    this.frames[shape.frame].add(body);
    if (shape.side) {
      const along = new THREE.Vector3(shape.side / 2, 0, 0).applyQuaternion(body.quaternion);
      const closed = body.position.clone().addScaledVector(along, shape.box_m[0]);
      this.fingers.push({ body, along, closed });
    }
  }

  bench() {
    const table = this.mesh(new THREE.BoxGeometry(1.4, 1.4, 0.02), 0xe6e3db);
    table.position.set(0.6, 0, -0.01);
    this.scene.add(table);
    for (const { name, pose, size_m } of this.told.boxes) {
      const bin = name.includes("bin");
      const colour = name === "the bracket" ? COLOURS.bracket : COLOURS.other;
      const body = bin ? this.bin(name, size_m) : this.mesh(new THREE.BoxGeometry(...size_m), colour);
      this.scene.add(this.place(body, pose));
    }
    this.bracket = this.place(new THREE.Group(), this.told.bracket);
    this.scene.add(this.bracket);
    for (const [x, y] of Object.values(this.still.holes)) {
      const hole = this.mesh(new THREE.CylinderGeometry(this.told.hole_radius_m, this.told.hole_radius_m, 0.002, 24), 0x111111);
      hole.rotation.x = Math.PI / 2;
      hole.position.set(x, y, 0);
      this.bracket.add(hole);
    }
  }

  // Open above, with the parts that it is named after.
  bin(name, [x, y, z]) {
    const [group, wall, high] = [new THREE.Group(), 0.004, 0.6 * z];
    const sides = [[x, wall, 0, y / 2], [x, wall, 0, -y / 2], [wall, y, x / 2, 0], [wall, y, -x / 2, 0]];
    for (const [wide, deep, atX, atY] of sides) {
      const side = this.mesh(new THREE.BoxGeometry(wide, deep, high), COLOURS.bin);
      side.position.set(atX, atY, (high - z) / 2);
      group.add(side);
    }
    const [type] = Object.entries(this.still.parts).find(([, { title }]) => name === `the bin of ${title}s`) ?? [];
    for (const [atX, atY] of type ? [[-1, -1], [-1, 1], [1, -1], [1, 1]] : []) {
      const part = this.part(type);
      part.position.set(0.2 * atX * x, 0.2 * atY * y, -z / 2);
      group.add(part);
    }
    return group;
  }

  // A palm with four fingers and a thumb, along x, of length 1.
  palm() {
    const group = new THREE.Group();
    const add = (long, thick, x, y, turn = 0) => {
      const body = this.mesh(new THREE.CapsuleGeometry(thick, long, 4, 10), COLOURS.hand);
      body.rotation.z = Math.PI / 2 + turn;
      body.position.set(x, y, 0);
      group.add(body);
    };
    for (const y of [-0.12, 0.0, 0.12]) add(0.3, 0.12, -0.28, y);
    for (const [number, y] of [-0.2, -0.07, 0.07, 0.2].entries()) add(number % 3 ? 0.42 : 0.34, 0.055, 0.2, y);
    add(0.3, 0.06, -0.15, 0.3, 0.7);
    return group;
  }

  part(type, opacity = 1) {
    const group = new THREE.Group();
    const rgb = this.still.parts[type]?.rgb ?? [136, 136, 136];
    for (const one of this.told.parts[type] ?? []) {
      const [x, y, z] = one.size_m;
      let geometry = new THREE.BoxGeometry(x, y, z);
      if (one.solid === "ball") geometry = new THREE.SphereGeometry(0.5, 18, 12).scale(x, y, z);
      if (one.solid === "cylinder") {
        geometry = new THREE.CylinderGeometry(0.5, 0.5, 1, 20); // along y
        if (one.axis === "x") geometry.rotateZ(Math.PI / 2);
        if (one.axis === "z") geometry.rotateX(Math.PI / 2);
        geometry.scale(x, y, z);
      }
      if (one.solid === "hull") {
        geometry = new THREE.BufferGeometry();
        geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(one.faces_m.flat(2)), 3));
        geometry.computeVertexNormals();
        geometry.translate(-one.centre_m[0], -one.centre_m[1], -one.centre_m[2]);
      }
      const colour = new THREE.Color(`rgb(${rgb.map((value) => Math.round(value * one.shade)).join(",")})`);
      const body = this.mesh(geometry, colour, opacity);
      body.position.set(...one.centre_m);
      group.add(body);
    }
    return group;
  }

  show({ pose, bracket, tray, hand }) {
    const now = JSON.stringify([pose, hand.at_m, bracket, tray]);
    if (now === this.now) return; // nothing has moved
    this.now = now;
    this.joints.forEach(({ turning, axis }, number) => turning.quaternion.setFromAxisAngle(axis, pose.joints_rad[number]));
    for (const { body, along, closed } of this.fingers) body.position.copy(closed).addScaledVector(along, pose.opening_m);
    this.hand.visible = Boolean(hand.at_m);
    if (hand.at_m) {
      const [tipX, tipY, palmX, palmY] = hand.at_m;
      const long = Math.max(0.18, 2 * Math.hypot(tipX - palmX, tipY - palmY));
      this.hand.position.set((tipX + palmX) / 2, (tipY + palmY) / 2, 0.09);
      this.hand.scale.setScalar(long);
      this.hand.rotation.z = Math.atan2(tipY - palmY, tipX - palmX);
    }
    this.parts(bracket, tray);
    this.draw();
  }

  // Parts change seldom: they are made anew only then.
  parts(bracket, tray) {
    const key = JSON.stringify([bracket, tray]);
    if (key === this.key) return;
    this.key = key;
    this.moving.traverse((one) => one.geometry?.dispose());
    this.moving.clear();
    const inBracket = this.place(new THREE.Group(), this.told.bracket);
    for (const [name, { status, parts }] of Object.entries(bracket)) {
      if (status === "open" || !parts.length) continue;
      const part = this.part(parts[0], status === "placed" ? 1 : GHOST);
      part.position.set(...this.still.holes[name], 0);
      inBracket.add(part);
    }
    this.moving.add(inBracket);
    for (const { part, position_m, quaternion_wxyz: [w, x, y, z] } of tray) {
      this.moving.add(this.place(this.part(part), [...position_m, x, y, z, w]));
    }
  }

  draw() {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    if (!width || !height) return;
    const wanted = Math.min(devicePixelRatio, 2);
    if (this.width !== width || this.height !== height) {
      [this.width, this.height] = [width, height];
      this.renderer.setPixelRatio(wanted);
      this.renderer.setSize(width, height, false);
      this.camera.aspect = width / height;
      this.camera.updateProjectionMatrix();
    }
    const { around, above, away } = this.turn;
    const far = away * Math.max(1, 1.1 / this.camera.aspect);
    const flat = far * Math.cos(above);
    this.camera.position.set(0.45 + flat * Math.cos(around), flat * Math.sin(around), 0.15 + far * Math.sin(above));
    this.camera.lookAt(0.45, 0, 0.15);
    this.renderer.render(this.scene, this.camera);
    this.canvas.dataset.drawn = Number(this.canvas.dataset.drawn ?? 0) + 1;
  }

  drag() {
    this.canvas.style.touchAction = "none";
    this.canvas.addEventListener("pointermove", (event) => {
      if (!event.buttons) return;
      this.turn.around -= event.movementX * 0.008;
      this.turn.above = Math.min(1.5, Math.max(0.05, this.turn.above + event.movementY * 0.008));
      this.draw();
    });
    this.canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.turn.away = Math.min(5, Math.max(0.6, this.turn.away * (1 + event.deltaY * 0.001)));
      this.draw();
    });
  }
}
