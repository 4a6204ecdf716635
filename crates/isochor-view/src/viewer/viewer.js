// The 3D view of a report page: poses of one model, turned, zoomed and moved by hand.
//
// The page holds the markup (buttons, legend, messages) and the geometry as JSON; this file draws it and makes the buttons
// work. It draws when something changed and never otherwise, and it asks the network for nothing.
//
// Geometry is one list of triangles and edges for all poses, and positions for each pose, relative to the centre of all
// poses and in units of a power of two near their size: so models far away or tiny ones are drawn as any other.

import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DirectionalLight,
  DoubleSide,
  Group,
  HemisphereLight,
  LineBasicMaterial,
  LineSegments,
  Matrix4,
  Mesh,
  MeshStandardMaterial,
  PerspectiveCamera,
  Points,
  PointsMaterial,
  Quaternion,
  Scene,
  Spherical,
  SRGBColorSpace,
  Vector3,
  WebGLRenderer,
} from 'three';
import { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';

// Faces that meet at less than this angle look like one curved surface. Larger: edges of a coarse cube's bevels blur;
// smaller: coarse spheres look faceted.
const CREASE_DEGREES = 40;
// Of more corners at one vertex only so many count for its normals: the work is the square of their number.
const MOST_CORNERS = 400;
// Degrees, as in pictures. Larger: depth is exaggerated; smaller: hardly any depth.
const FIELD_OF_VIEW = 24;
// Of the distance at which the model touches the border.
const MARGIN = 1.06;
// As in pictures: from the front, a little from the right and from above; y is up here.
const VIEW_FROM = new Vector3().setFromSphericalCoords(1, ((90 - 22) * Math.PI) / 180, (30 * Math.PI) / 180);
// Lattices that reach farther than this, in units of the model (which is between -1 and 1), do not count for the first view:
// the model would be a dot among them.
const FAR_CONTROL = 3;
// One press of an arrow key.
const TURN = Math.PI / 24;
const ZOOM = 1.15;
// Finer screens show no more, and take longer to fill.
const MOST_PIXELS_PER_POINT = 2;
// Width of a control point on the screen.
const DOT = 4.5;
// And of a node that is held: light ones look smaller.
const HELD_DOT = 6;

const CLAY = '#b9c4d0';
// From volume lost through unchanged to gained, in equal steps of the logarithm: every fourth colour of the scale of
// pictures. Also in page.css.
const CHANGES = [
  '#3b4cc0', '#6282ea', '#8db0fe', '#b8d0f9', '#dddddd', '#f5c4ad', '#f49a7b', '#de604d', '#b40426',
];
// Turned inside out.
const FOLDED = '#ff00c8';

const figure = document.querySelector('[data-viewer]');
if (figure) {
  start(figure, JSON.parse(document.getElementById('geometry').textContent));
}

function start(figure, data) {
  const canvas = figure.querySelector('canvas');
  let renderer;
  try {
    // The buffer is kept so that a printed page has the picture.
    renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
  } catch {
    figure.dataset.state = 'no-webgl';
    return;
  }

  const model = decoded(data);
  const scene = new Scene();
  const camera = new PerspectiveCamera(FIELD_OF_VIEW, 1, 0.01, 100);
  // From a frame in which y is up and z is to the front.
  camera.up.fromArray(data.up);
  const right = data.up[0] === 1 ? new Vector3(0, 1, 0) : new Vector3(1, 0, 0);
  const basis = new Matrix4().makeBasis(right, camera.up, right.clone().cross(camera.up));
  const fromUpright = new Quaternion().setFromRotationMatrix(basis);
  const toUpright = fromUpright.clone().invert();
  const lamp = new DirectionalLight(0xffffff, 1.7);
  // It goes with the camera: from above its left shoulder.
  lamp.position.set(-0.6, 1, 1.4);
  camera.add(lamp, lamp.target);
  const sky = new HemisphereLight(0xffffff, 0x8d9199, 2);
  sky.position.copy(camera.up);
  scene.add(camera, sky);
  const shown = new Group();
  scene.add(shown);

  const surface = new MeshStandardMaterial({ roughness: 0.62, metalness: 0, side: DoubleSide });
  const edges = new LineBasicMaterial({ transparent: true, opacity: 0.4 });
  const rods = new LineBasicMaterial({ transparent: true, opacity: 0.45 });
  const springs = new LineBasicMaterial({ transparent: true, opacity: 0.25 });
  // Control points, and nodes that are held while the others settle.
  const [knobs, pins] = [0, 1].map(() => new PointsMaterial({ sizeAttenuation: false }));
  knobs.onBeforeCompile = pins.onBeforeCompile = (shader) => {
    const round = 'if (length(gl_PointCoord - 0.5) > 0.5) discard;\n#include <clipping_planes_fragment>';
    shader.fragmentShader = shader.fragmentShader.replace('#include <clipping_planes_fragment>', round);
  };

  const state = { pose: model.poses.length - 1 };
  for (const button of figure.querySelectorAll('[data-toggle]')) {
    state[button.dataset.toggle] = button.getAttribute('aria-pressed') === 'true';
  }

  const controls = new OrbitControls(camera, canvas);
  controls.enableZoom = false; // the wheel scrolls the page until the view was clicked
  controls.minDistance = model.radius / 20;
  controls.maxDistance = model.radius * 40;

  let isAsked = false;
  const draw = () => {
    isAsked = false;
    // Near and far follow the distance: depths stay well separated however near one comes.
    const distance = camera.position.distanceTo(controls.target);
    camera.near = Math.max(distance - 3 * model.radius, distance / 100);
    camera.far = distance + 3 * model.radius;
    camera.updateProjectionMatrix();
    renderer.render(scene, camera);
    figure.dataset.state = 'ready';
  };
  const ask = () => {
    if (!isAsked) {
      isAsked = true;
      requestAnimationFrame(draw);
    }
  };

  const home = () => {
    // As near as all poses fit: (x, y, z) of the camera is in the picture where |x| ≤ s (d − z), |y| ≤ t (d − z).
    const t = Math.tan((FIELD_OF_VIEW * Math.PI) / 360);
    const s = t * camera.aspect;
    const towards = VIEW_FROM.clone().applyQuaternion(fromUpright);
    const right = camera.up.clone().cross(towards).normalize();
    const up = towards.clone().cross(right);
    let distance = model.radius / 10;
    for (const points of model.positions) {
      for (let i = 0; i < points.length; i += 3) {
        const place = new Vector3(points[i], points[i + 1], points[i + 2]).sub(model.center);
        const needed = Math.max(Math.abs(place.dot(right)) / s, Math.abs(place.dot(up)) / t);
        distance = Math.max(distance, needed + place.dot(towards));
      }
    }
    controls.target.copy(model.center);
    camera.position.copy(towards).setLength(distance * MARGIN).add(model.center);
    controls.update();
    ask();
  };

  const paint = () => {
    const style = getComputedStyle(figure);
    const color = (name) => new Color().setStyle(style.getPropertyValue(name).trim());
    edges.color = color('--edge');
    rods.color = springs.color = knobs.color = color('--lattice');
    pins.color = color('--held');
    ask();
  };

  const show = () => {
    const pose = model.poses[state.pose];
    shown.clear();
    const isColoured = state.colour && pose.change !== null;
    surface.vertexColors = isColoured;
    surface.color.set(isColoured ? '#ffffff' : CLAY);
    surface.polygonOffset = state.wireframe;
    surface.polygonOffsetFactor = surface.polygonOffsetUnits = 1;
    surface.needsUpdate = true;
    shown.add(new Mesh(pose.surface(state.smooth, isColoured), surface));
    if (state.wireframe) {
      shown.add(new LineSegments(pose.edges(), edges));
    }
    if (state.lattice && pose.lattice) {
      const { lines, isNet, free, held } = pose.lattice();
      shown.add(new LineSegments(lines, isNet ? springs : rods), new Points(free, knobs), new Points(held, pins));
    }
    for (const button of figure.querySelectorAll('[data-pose]')) {
      button.setAttribute('aria-pressed', String(Number(button.dataset.pose) === state.pose));
    }
    for (const button of figure.querySelectorAll('[data-toggle]')) {
      button.setAttribute('aria-pressed', String(state[button.dataset.toggle]));
    }
    const pressed = figure.querySelector(`[data-pose="${state.pose}"]`);
    figure.querySelector('[data-said]').textContent = pressed ? pressed.dataset.says : '';
    const legend = figure.querySelector('[data-legend]');
    if (legend) {
      legend.hidden = !isColoured;
    }
    ask();
  };

  const pose = (index) => {
    if (index < model.poses.length) {
      state.pose = index;
      show();
    }
  };
  const toggle = (name) => {
    if (name in state) {
      state[name] = !state[name];
      show();
    }
  };

  // Turns the camera about the target: angles to the right and down.
  const turn = (right, down) => {
    const offset = camera.position.clone().sub(controls.target).applyQuaternion(toUpright);
    const angles = new Spherical().setFromVector3(offset);
    angles.theta += right;
    angles.phi = Math.min(Math.max(angles.phi - down, 0.01), Math.PI - 0.01);
    offset.setFromSpherical(angles).applyQuaternion(fromUpright);
    camera.position.copy(controls.target).add(offset);
    controls.update();
  };
  const zoom = (factor) => {
    camera.position.sub(controls.target).multiplyScalar(1 / factor).add(controls.target);
    controls.update();
  };

  const keys = {
    ArrowLeft: () => turn(TURN, 0),
    ArrowRight: () => turn(-TURN, 0),
    ArrowUp: () => turn(0, -TURN),
    ArrowDown: () => turn(0, TURN),
    '+': () => zoom(ZOOM),
    '=': () => zoom(ZOOM),
    '-': () => zoom(1 / ZOOM),
    0: home,
    Home: home,
    l: () => toggle('lattice'),
    c: () => toggle('colour'),
    w: () => toggle('wireframe'),
    s: () => toggle('smooth'),
  };
  for (let digit = 1; digit <= Math.min(9, model.poses.length); digit++) {
    keys[digit] = () => pose(digit - 1);
  }
  figure.addEventListener('keydown', (event) => {
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (!event.ctrlKey && !event.metaKey && !event.altKey && Object.hasOwn(keys, key)) {
      keys[key]();
      event.preventDefault();
    }
  });
  figure.addEventListener('click', (event) => {
    const button = event.target.closest('button');
    if (!button) {
      return;
    }
    if (button.dataset.pose !== undefined) {
      pose(Number(button.dataset.pose));
    } else if (button.dataset.toggle !== undefined) {
      toggle(button.dataset.toggle);
    } else if (button.dataset.home !== undefined) {
      home();
    }
  });
  const wake = () => {
    controls.enableZoom = true;
  };
  canvas.addEventListener('pointerdown', () => {
    wake();
    canvas.focus({ preventScroll: true });
  }, true);
  canvas.addEventListener('focus', wake);
  canvas.addEventListener('blur', () => {
    controls.enableZoom = false;
  });
  controls.addEventListener('change', ask);
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', paint);
  canvas.addEventListener('webglcontextrestored', ask);

  let isFirst = true;
  const fit = () => {
    const { clientWidth: width, clientHeight: height } = canvas;
    if (width === 0 || height === 0) {
      return;
    }
    const pixelsPerPoint = Math.min(devicePixelRatio, MOST_PIXELS_PER_POINT);
    renderer.setPixelRatio(pixelsPerPoint);
    knobs.size = DOT * pixelsPerPoint;
    pins.size = HELD_DOT * pixelsPerPoint;
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    if (isFirst) {
      isFirst = false;
      home();
    }
    draw();
  };
  paint();
  show();
  for (const button of figure.querySelectorAll('button')) {
    button.disabled = false;
  }
  new ResizeObserver(fit).observe(canvas);
  fit();
}

// The page's geometry as typed arrays, and what is drawn of it, made when it is first wanted.
function decoded(data) {
  const triangles = new Uint32Array(bytes(data.triangles));
  const sides = data.edges === null ? null : new Uint8Array(bytes(data.edges));
  const colours = data.scale === null ? null : ramp(data.scale);
  const positions = data.poses.map((pose) => new Float32Array(bytes(pose.points)));
  const touching = cornersOfVertices(triangles, positions[0].length / 3);
  const lines = once(() => new BufferAttribute(edgeLines(triangles, sides), 1));

  const low = new Vector3(Infinity, Infinity, Infinity);
  const high = low.clone().negate();
  const controls = data.poses.flatMap((pose) => (pose.lattice ? [new Float32Array(bytes(pose.lattice.controls))] : []));
  const isNear = (points) => points.every((x) => Math.abs(x) < FAR_CONTROL);
  const seen = [...positions, ...controls.filter(isNear)];
  for (const points of seen) {
    for (let i = 0; i < points.length; i += 3) {
      const place = new Vector3(points[i], points[i + 1], points[i + 2]);
      low.min(place);
      high.max(place);
    }
  }
  const poses = data.poses.map((pose, p) => {
    const points = positions[p];
    const change = pose.change === null ? null : new Float32Array(bytes(pose.change));
    const corners = once(() => new BufferAttribute(perCorner(triangles, points), 3));
    const flat = once(() => new BufferAttribute(faceNormals(triangles, points).corners, 3));
    const smooth = once(() => new BufferAttribute(creasedNormals(triangles, points, touching), 3));
    const colour = once(() => new BufferAttribute(perCorner(triangles, colours(change)), 3));
    const vertices = once(() => new BufferAttribute(points, 3));
    return {
      change,
      surface: (isSmooth, isColoured) => {
        const geometry = new BufferGeometry();
        geometry.setAttribute('position', corners());
        geometry.setAttribute('normal', isSmooth ? smooth() : flat());
        if (isColoured) {
          geometry.setAttribute('color', colour());
        }
        return geometry;
      },
      edges: once(() => new BufferGeometry().setAttribute('position', vertices()).setIndex(lines())),
      lattice: pose.lattice && once(() => latticeLines(pose.lattice)),
    };
  });
  if (!(low.x <= high.x)) {
    low.set(-0.5, -0.5, -0.5);
    high.set(0.5, 0.5, 0.5);
  }
  const center = low.clone().add(high).multiplyScalar(0.5);
  return { poses, positions: seen, center, radius: Math.max(high.distanceTo(low) / 2, 1e-3) };
}

// Little-endian numbers, as the machine has them on which browsers run.
function bytes(base64) {
  return Uint8Array.from(atob(base64), (character) => character.charCodeAt(0)).buffer;
}

function once(make) {
  let made;
  return () => (made ??= make());
}

// What each vertex has, for each corner of each triangle.
function perCorner(triangles, values) {
  const out = new Float32Array(triangles.length * 3);
  for (let c = 0; c < triangles.length; c++) {
    out.set(values.subarray(3 * triangles[c], 3 * triangles[c] + 3), 3 * c);
  }
  return out;
}

// Corners that are at each vertex: `corners[starts[v] .. starts[v + 1]]`.
function cornersOfVertices(triangles, vertices) {
  const starts = new Uint32Array(vertices + 1);
  triangles.forEach((v) => starts[v + 1]++);
  for (let v = 0; v < vertices; v++) {
    starts[v + 1] += starts[v];
  }
  const next = starts.slice();
  const corners = new Uint32Array(triangles.length);
  triangles.forEach((v, c) => {
    corners[next[v]++] = c;
  });
  return { starts, corners };
}

// Unit normals for each corner, and the normals of triangles, twice as long as their areas.
function faceNormals(triangles, points) {
  const corners = new Float32Array(triangles.length * 3);
  const weighted = new Float64Array(triangles.length);
  for (let t = 0; t < triangles.length; t += 3) {
    const [a, b, c] = [3 * triangles[t], 3 * triangles[t + 1], 3 * triangles[t + 2]];
    const [ux, uy, uz] = [points[b] - points[a], points[b + 1] - points[a + 1], points[b + 2] - points[a + 2]];
    const [vx, vy, vz] = [points[c] - points[a], points[c + 1] - points[a + 1], points[c + 2] - points[a + 2]];
    const normal = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    weighted.set(normal, t);
    const length = Math.hypot(...normal) || 1;
    for (let corner = t; corner < t + 3; corner++) {
      corners.set(normal.map((x) => x / length), 3 * corner);
    }
  }
  return { corners, weighted };
}

// At each corner the mean of the normals round the vertex that are within the crease angle of the corner's own triangle.
function creasedNormals(triangles, points, { starts, corners }) {
  const { corners: flat, weighted } = faceNormals(triangles, points);
  const least = Math.cos((CREASE_DEGREES * Math.PI) / 180);
  const out = new Float32Array(flat.length);
  for (let v = 0; v + 1 < starts.length; v++) {
    const end = Math.min(starts[v + 1], starts[v] + MOST_CORNERS);
    for (let i = starts[v]; i < starts[v + 1]; i++) {
      const own = 3 * corners[i];
      let [x, y, z] = [0, 0, 0];
      for (let j = starts[v]; j < end; j++) {
        const other = 3 * corners[j];
        const cosine = flat[own] * flat[other] + flat[own + 1] * flat[other + 1] + flat[own + 2] * flat[other + 2];
        if (cosine >= least) {
          const face = corners[j] - (corners[j] % 3);
          x += weighted[face];
          y += weighted[face + 1];
          z += weighted[face + 2];
        }
      }
      const length = Math.hypot(x, y, z);
      out.set(length > 0 ? [x / length, y / length, z / length] : flat.subarray(own, own + 3), own);
    }
  }
  return out;
}

// Each edge once. Bit k of `sides` says whether the side of a triangle after its corner k is an edge of a face.
function edgeLines(triangles, sides) {
  const vertices = triangles.reduce((most, v) => Math.max(most, v), 0) + 1;
  const seen = new Set();
  const lines = [];
  for (let c = 0; c < triangles.length; c++) {
    const corner = c % 3;
    if (sides !== null && !((sides[(c - corner) / 3] >> corner) & 1)) {
      continue;
    }
    const a = triangles[c];
    const b = triangles[corner === 2 ? c - 2 : c + 1];
    const key = Math.min(a, b) * vertices + Math.max(a, b);
    if (!seen.has(key)) {
      seen.add(key);
      lines.push(a, b);
    }
  }
  return new Uint32Array(lines);
}

// Control points, free and held, and springs, or else the lines between neighbours along u, v, w.
function latticeLines({ size, controls, springs, held }) {
  const places = new BufferAttribute(new Float32Array(bytes(controls)), 3);
  const of = (indices) =>
    new BufferGeometry().setAttribute('position', places).setIndex(new BufferAttribute(new Uint32Array(indices), 1));
  const isHeld = held === null ? new Uint8Array(places.count) : new Uint8Array(bytes(held));
  const nodes = [...isHeld.keys()];
  return {
    lines: of(springs === null ? edgesOfLattice(size) : bytes(springs)),
    isNet: springs !== null,
    free: of(nodes.filter((node) => !isHeld[node])),
    held: of(nodes.filter((node) => isHeld[node])),
  };
}

// Ends of the lines between neighbours along u, v, w.
function edgesOfLattice(size) {
  const steps = [size[1] * size[2], size[2], 1];
  const lines = [];
  for (let i = 0; i < size[0]; i++) {
    for (let j = 0; j < size[1]; j++) {
      for (let k = 0; k < size[2]; k++) {
        const here = i * steps[0] + j * steps[1] + k;
        [i, j, k].forEach((index, axis) => {
          if (index + 1 < size[axis]) {
            lines.push(here, here + steps[axis]);
          }
        });
      }
    }
  }
  return lines;
}

// Colours (3 per vertex) of local volume changes; `scale` is the change at the end of the ramp.
function ramp(scale) {
  const linear = (hex) => new Color().setStyle(hex, SRGBColorSpace);
  const stops = CHANGES.map(linear);
  const folded = linear(FOLDED);
  const most = stops.length - 1;
  return (changes) => {
    const out = new Float32Array(3 * changes.length);
    const colour = new Color();
    changes.forEach((change, v) => {
      if (change <= 0) {
        colour.copy(folded);
      } else {
        const t = Number.isNaN(change) ? 0.5 : (Math.log(change) / Math.log(scale) + 1) / 2;
        const at = Math.min(Math.max(t, 0), 1) * most;
        const below = Math.min(Math.floor(at), most - 1);
        colour.lerpColors(stops[below], stops[below + 1], at - below);
      }
      colour.toArray(out, 3 * v);
    });
    return out;
  };
}
