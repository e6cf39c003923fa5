// The viewer of the report page: two meshes, one camera, WebGL 2 without a library.
//
// Triangles are drawn corner by corner, not indexed: edges, and colours of the cells around vertices, need to know in which
// corner of which triangle a pixel lies. A colouring is three numbers a triangle, one a corner, and a palette.
'use strict';

(() => {
  const data = JSON.parse(document.getElementById('data').textContent);
  const element = (id) => document.getElementById(id);
  const stage = element('stage'), canvas = element('canvas');

  // --- Palettes that colour-blind people can read ------------------------------------------------------------------------

  const kViridis = ['#440154', '#482475', '#414487', '#355f8d', '#2a788e', '#21918c', '#22a884', '#44bf70', '#7ad151', '#bddf26', '#fde725'];
  // Okabe & Ito, "Color universal design", 2008.
  const kValences = [
    {name: '4 and less', colour: '#cc79a7', has: (d) => d <= 4},
    {name: '5', colour: '#0072b2', has: (d) => d === 5},
    {name: '6', colour: '#009e73', has: (d) => d === 6},
    {name: '7', colour: '#e69f00', has: (d) => d === 7},
    {name: '8 and more', colour: '#d55e00', has: (d) => d >= 8 && d < kNoValence},
    {name: 'on a border', colour: '#999999', has: (d) => d === kNoValence},
  ];
  const kNoValence = 255;
  const kGapColour = '#d55e00';

  const rgb = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
  const mixed = (a, b, t) => a.map((x, k) => x + t * (b[k] - x));

  /** 256 colours, evenly between those given. */
  function continuousPalette(colours) {
    const stops = colours.map(rgb);
    const pixels = new Uint8Array(4 * 256).fill(255);
    for (let i = 0; i < 256; ++i) {
      const place = i / 255 * (stops.length - 1);
      const low = Math.min(Math.floor(place), stops.length - 2);
      pixels.set(mixed(stops[low], stops[low + 1], place - low).map(Math.round), 4 * i);
    }
    return pixels;
  }

  /** Colour i of the list at i. */
  function classPalette(colours) {
    const pixels = new Uint8Array(4 * 256).fill(255);
    colours.forEach((colour, i) => pixels.set(rgb(colour), 4 * i));
    return pixels;
  }

  // --- The meshes --------------------------------------------------------------------------------------------------------

  /** Base64 as the little-endian numbers it holds. */
  function decoded(text, Type) {
    const bytes = atob(text || '');
    const buffer = new Uint8Array(bytes.length);
    for (let i = 0; i < bytes.length; ++i) buffer[i] = bytes.charCodeAt(i);
    return new Type(buffer.buffer);
  }

  const views = [data.input, data.output].map((view) => ({
    positions: decoded(view.positions, Float32Array),  // by vertex, in half diagonals of the input's box, around its middle
    indices: decoded(view.indices, Uint32Array),
    valences: decoded(view.valences, Uint8Array),       // by vertex
    radii: decoded(view.radii, Float32Array),          // by vertex, 0 to 1 over data.radius; none of the input
    distances: decoded(view.distances, Float32Array),  // by triangle, 0 to 1 over data.distance; below 0: not known
    curves: decoded(view.curves, Uint32Array),         // pairs of vertices
  }));
  const gaps = decoded(data.gaps, Float32Array);  // three corners a triangle

  const gathered = (positions, indices) => {
    const corners = new Float32Array(3 * indices.length);
    for (let i = 0; i < indices.length; ++i) {
      for (let k = 0; k < 3; ++k) corners[3 * i + k] = positions[3 * indices[i] + k];
    }
    return corners;
  };

  /** The smallest and the largest angle of each triangle, degrees. */
  function extremeAngles(corners) {
    const n = corners.length / 9;
    const smallest = new Float32Array(n), largest = new Float32Array(n);
    for (let t = 0; t < n; ++t) {
      smallest[t] = 180;
      for (let k = 0; k < 3; ++k) {
        const [a, b, c] = [0, 1, 2].map((j) => 9 * t + 3 * ((k + j) % 3));
        let dot = 0, uu = 0, vv = 0;
        for (let x = 0; x < 3; ++x) {
          const u = corners[b + x] - corners[a + x], v = corners[c + x] - corners[a + x];
          dot += u * v, uu += u * u, vv += v * v;
        }
        const angle = Math.acos(Math.max(-1, Math.min(1, dot / Math.sqrt(uu * vv || 1)))) * 180 / Math.PI;
        smallest[t] = Math.min(smallest[t], angle);
        largest[t] = Math.max(largest[t], angle);
      }
    }
    return {smallest, largest};
  }

  for (const view of views) {
    view.corners = gathered(view.positions, view.indices);
    view.angles = extremeAngles(view.corners);
  }

  // --- Colourings: numbers by corner, from 0 to 1 or a class; below 0: none ----------------------------------------------

  const scaled = (x, [low, high]) => Math.max(0, Math.min(1, (x - low) / (high - low)));
  const byVertex = (view, value) => Float32Array.from(view.indices, (v) => value(v));
  const byTriangle = (values, value) => {
    const result = new Float32Array(3 * values.length);
    for (let t = 0; t < values.length; ++t) result.fill(value(values[t]), 3 * t, 3 * t + 3);
    return result;
  };

  const kColourings = {
    shape: {legend: () => curveLegend()},
    valence: {
      classes: true,
      palette: classPalette(kValences.map((c) => c.colour)),
      values: (view) => byVertex(view, (v) => kValences.findIndex((c) => c.has(view.valences[v]))),
      legend: () => classLegend('Neighbours of a vertex, which colour what is nearest to it; vertices of input → output', kValences.map((c) => ({
        ...c,
        counts: views.map((view) => view.valences.reduce((sum, d) => sum + (c.has(d) ? 1 : 0), 0)),
      })).filter((c) => c.counts.some((n) => n > 0))),
    },
    smallest: angleColouring('smallest', 'Smallest angle of a triangle, degrees', [0, 60]),
    largest: angleColouring('largest', 'Largest angle of a triangle, degrees', [60, 180]),
    radius: {
      palette: continuousPalette(kViridis),
      values: (view) => view.radii.length === 0 ? null : byVertex(view, (v) => view.radii[v]),
      legend: () => data.radius.low === data.radius.high ?
          note(`All disks of the output have one radius: ${shown(data.radius.low)}. The input has no disks.`) :
          barLegend('Radius of the disk around a vertex of the output', [data.radius.low, data.radius.high]),
    },
    gaps: {
      gaps: true,
      legend: () => gaps.length > 0 ?
          classLegend(data.gapText, [{name: 'not in any disk, drawn over both meshes', colour: kGapColour}]) :
          note(data.gapText),
    },
    distance: {
      palette: continuousPalette(kViridis),
      values: (view) => byTriangle(view.distances, (d) => d),
      legend: () => barLegend('Distance to the other mesh, the greatest of seven points of a triangle, in % of the diagonal; ' +
          `one in a hundred triangles is beyond the scale, at most at ${shown(data.distance.farthest)} %`, [0, data.distance.high]),
    },
  };

  function angleColouring(which, title, range) {
    return {
      palette: continuousPalette(which === 'largest' ? kViridis.slice().reverse() : kViridis),
      values: (view) => byTriangle(view.angles[which], (a) => scaled(a, range)),
      legend: () => barLegend(title, range, which === 'largest'),
    };
  }

  // --- Legends -----------------------------------------------------------------------------------------------------------

  function make(name, attributes, ...children) {
    const made = document.createElement(name);
    Object.assign(made, attributes);
    made.append(...children);
    return made;
  }
  const shown = (x) => x === 0 ? '0' : String(Number(x.toPrecision(3)));
  const note = (text) => [make('p', {textContent: text})];

  function curveLegend() {
    const edges = views.map((view) => view.curves.length / 2);
    return note(edges[0] + edges[1] > 0 ?
        `Thick lines are curves that are kept: ${edges[0]} edges of the input, ${edges[1]} of the output. Insides are purple.` :
        'No curves are kept. Insides, seen through holes or on flipped triangles, are purple.');
  }
  function classLegend(title, classes) {
    const list = make('ul');
    for (const c of classes) {
      const swatch = make('span', {className: 'swatch'});
      swatch.style.background = c.colour;
      list.append(make('li', {}, swatch, c.counts ? `${c.name} (${c.counts.join(' → ')})` : c.name));
    }
    return [make('p', {textContent: title}), list];
  }
  function barLegend(title, [low, high], reversed = false) {
    const bar = make('div', {className: 'bar'});
    bar.style.background = `linear-gradient(to ${reversed ? 'left' : 'right'}, ${kViridis.join(', ')})`;
    const ticks = make('div', {className: 'ticks'});
    for (let i = 0; i <= 4; ++i) ticks.append(make('span', {textContent: shown(low + i / 4 * (high - low))}));
    return [make('p', {textContent: title}), bar, ticks];
  }

  // --- Drawing -----------------------------------------------------------------------------------------------------------

  const kMeshVertex = `#version 300 es
    in vec3 position;
    in vec3 values;
    uniform mat4 toEye, toClip;
    out vec3 eye;
    out vec3 corner;
    flat out vec3 value;
    void main() {
      vec4 at = toEye * vec4(position, 1.0);
      int k = gl_VertexID % 3;
      eye = at.xyz;
      corner = vec3(k == 0, k == 1, k == 2);
      value = values;
      gl_Position = toClip * at;
    }`;
  const kMeshFragment = `#version 300 es
    precision highp float;
    in vec3 eye;
    in vec3 corner;
    flat in vec3 value;
    uniform sampler2D palette;
    uniform bool coloured, classes, edges;
    uniform vec3 plain, inside, edgeColour;
    uniform float scale;  // pixels of the canvas in one of the page
    out vec4 colour;
    void main() {
      vec3 base = gl_FrontFacing ? plain : inside;
      if (coloured && value.x >= 0.0) {
        if (classes) {  // the class of the nearest corner
          float c = corner.x >= max(corner.y, corner.z) ? value.x : corner.y >= corner.z ? value.y : value.z;
          base = texelFetch(palette, ivec2(int(c + 0.5), 0), 0).rgb;
        } else {
          base = texelFetch(palette, ivec2(int(255.0 * clamp(dot(corner, value), 0.0, 1.0) + 0.5), 0), 0).rgb;
        }
      }
      vec3 normal = normalize(cross(dFdx(eye), dFdy(eye)));  // of the triangle, towards the viewer
      float key = max(dot(normal, normalize(vec3(-0.35, 0.5, 0.8))), 0.0);
      float fill = max(dot(normal, normalize(vec3(0.7, -0.1, 0.6))), 0.0);
      colour = vec4(base * (0.42 + 0.5 * key + 0.16 * fill), 1.0);
      if (edges) {
        vec3 perPixel = fwidth(corner);
        vec3 pixels = corner / perPixel;  // to the three sides
        float height = 1.0 / max(perPixel.x, max(perPixel.y, perPixel.z));  // of the triangle, in pixels
        // Half of a line's width: a share of the triangle, so that meshes of any size are as dark; below a pixel it fades.
        float width = min(0.12 * height, 0.6 * scale);
        float line = 1.0 - smoothstep(width - 0.5, width + 0.6, min(pixels.x, min(pixels.y, pixels.z)));
        colour.rgb = mix(colour.rgb, edgeColour, 0.75 * line * min(1.0, 1.6 * width));
      }
    }`;
  // A segment is four corners of a strip, as wide on screen as is asked for.
  const kLineVertex = `#version 300 es
    in vec3 from, to;
    uniform mat4 toEye, toClip;
    uniform vec2 halfSize;  // of the view, pixels
    uniform float halfWidth;
    void main() {
      vec4 a = toClip * toEye * vec4(from, 1.0), b = toClip * toEye * vec4(to, 1.0);
      vec2 along = (b.xy / b.w - a.xy / a.w) * halfSize;
      along = length(along) > 0.0 ? normalize(along) : vec2(1.0, 0.0);
      vec4 at = gl_VertexID < 2 ? a : b;
      float side = gl_VertexID % 2 == 0 ? -1.0 : 1.0, end = gl_VertexID < 2 ? -0.5 : 0.5;
      at.xy += (side * vec2(-along.y, along.x) + end * along) * halfWidth / halfSize * at.w;
      at.z -= 0.004 * at.w;  // before the triangles that it lies on
      gl_Position = at;
    }`;
  const kLineFragment = `#version 300 es
    precision mediump float;
    uniform vec3 plain;
    out vec4 colour;
    void main() { colour = vec4(plain, 1.0); }`;

  const kNoWebgl = 'This browser offers no WebGL 2, so the meshes are not drawn. The tables and charts below are all there.';
  function giveUp(message) {
    element('viewer').hidden = true;
    element('no-webgl').textContent = message;
    element('no-webgl').hidden = false;
  }

  const gl = views.every((view) => view.indices.length === 0) ? null : canvas.getContext('webgl2', {antialias: false});
  if (!gl) {
    giveUp(views.every((view) => view.indices.length === 0) ? data.notDrawn : kNoWebgl);
    return;
  }
  element('viewer').hidden = false;

  function makeProgram(vertex, fragment) {
    const program = gl.createProgram();
    for (const [type, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    const uniforms = {}, attributes = {};
    for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); ++i) {
      const {name} = gl.getActiveUniform(program, i);
      uniforms[name] = gl.getUniformLocation(program, name);
    }
    for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_ATTRIBUTES); ++i) {
      const {name} = gl.getActiveAttrib(program, i);
      attributes[name] = gl.getAttribLocation(program, name);
    }
    return {program, uniforms, attributes};
  }

  function makeBuffer(numbers) {
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, numbers, gl.STATIC_DRAW);
    return buffer;
  }
  /** `every`: 0: one item a vertex; 1: one an instance. */
  function bind(location, buffer, stride = 0, offset = 0, every = 0) {
    if (location === undefined) return;
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, 3, gl.FLOAT, false, stride, offset);
    gl.vertexAttribDivisor(location, every);
  }

  const meshProgram = makeProgram(kMeshVertex, kMeshFragment);
  const lineProgram = makeProgram(kLineVertex, kLineFragment);
  const makeTriangles = (corners) => {
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    bind(meshProgram.attributes.position, makeBuffer(corners));
    return {array, count: corners.length / 3, values: gl.createBuffer()};
  };
  const makeLines = (positions, pairs) => {
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    const ends = makeBuffer(gathered(positions, pairs));
    bind(lineProgram.attributes.from, ends, 24, 0, 1);
    bind(lineProgram.attributes.to, ends, 24, 12, 1);
    return {array, count: pairs.length / 2};
  };
  for (const view of views) {
    view.triangles = makeTriangles(view.corners);
    view.lines = makeLines(view.positions, view.curves);
  }
  const gapTriangles = makeTriangles(gaps);
  const palette = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, palette);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  gl.enable(gl.DEPTH_TEST);

  // --- The camera, of both views -----------------------------------------------------------------------------------------

  const kFieldOfView = 24 * Math.PI / 180;
  const kDistance = 0.9 / Math.sin(kFieldOfView / 2);  // the box's sphere, of radius 1, nearly fits
  const kLeastZoom = 0.2, kMostZoom = 200;
  const camera = {};

  function turned(rotation, right, up) {  // degrees, about the axes of the screen; columns are the model's axes
    const [y, x] = [right, up].map((angle) => angle * Math.PI / 180);
    const [cx, sx, cy, sy] = [Math.cos(x), Math.sin(x), Math.cos(y), Math.sin(y)];
    const columns = rotation.map(([a, b, c]) => {
      const [a1, c1] = [cy * a + sy * c, cy * c - sy * a];
      return [a1, cx * b - sx * c1, sx * b + cx * c1];
    });
    return orthonormal(columns);
  }
  function orthonormal([u, v]) {  // or rounding would pile up over thousands of turns
    const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const unit = (a) => a.map((x) => x / Math.sqrt(dot(a, a)));
    const first = unit(u), second = unit(v.map((x, k) => x - dot(v, first) * first[k]));
    const [a, b] = [first, second];
    return [a, b, [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]];
  }
  function reset() {
    camera.rotation = turned([[1, 0, 0], [0, 1, 0], [0, 0, 1]], -30, 18);
    camera.zoom = 1;
    camera.x = camera.y = 0;
    redraw();
  }
  function turn(right, up) {
    camera.rotation = turned(camera.rotation, right, up);
    redraw();
  }
  function zoom(factor) {
    camera.zoom = Math.max(kLeastZoom, Math.min(kMostZoom, camera.zoom * factor));
    redraw();
  }
  function move(x, y) {  // in heights of a view
    const height = 2 * Math.tan(kFieldOfView / 2) * kDistance / camera.zoom;
    camera.x += x * height;
    camera.y += y * height;
    redraw();
  }

  function matrices(width, height) {
    const distance = kDistance / camera.zoom, [u, v, w] = camera.rotation;
    const toEye = [...u, 0, ...v, 0, ...w, 0, camera.x, camera.y, -distance, 1];
    const reach = 1.2 + Math.hypot(camera.x, camera.y);
    const near = Math.max(distance - reach, 0.02 * distance), far = distance + reach;
    const f = Math.min(1, width / height) / Math.tan(kFieldOfView / 2);  // the sphere fits the shorter side
    const toClip = [f * height / width, 0, 0, 0, 0, f, 0, 0, 0, 0, (near + far) / (near - far), -1, 0, 0,
      2 * near * far / (near - far), 0];
    return {toEye, toClip};
  }

  // --- A picture ---------------------------------------------------------------------------------------------------------

  const kLight = {stage: '#f1f3f5', plain: '#bcc7d1', inside: '#a8719a', edge: '#1d2833', curve: '#000000'};
  const kDark = {stage: '#22262b', plain: '#8d9aa6', inside: '#8a5a7d', edge: '#0c0f12', curve: '#ffffff'};
  const dark = matchMedia('(prefers-color-scheme: dark)');
  const shade = (hex) => rgb(hex).map((x) => x / 255);

  // While something moves, a pixel of the canvas is one of the screen; at rest it is half as wide, in place of the driver's
  // antialiasing, which takes eight times as long on software renderers.
  const kRestMilliseconds = 150, kFinestScale = 3;
  let pending = 0, resting = 0;
  function redraw() {
    canvas.dataset.sharp = 'no';
    clearTimeout(resting);
    resting = setTimeout(() => {
      if (pending !== 0) cancelAnimationFrame(pending);
      pending = requestAnimationFrame(() => draw(true));
    }, kRestMilliseconds);
    if (pending === 0) pending = requestAnimationFrame(() => draw(false));
  }

  function setColouring() {
    const colouring = kColourings[element('colouring').value];
    element('legend').replaceChildren(...colouring.legend());
    for (const view of views) {
      const values = colouring.values ? colouring.values(view) : null;
      view.coloured = values !== null;
      gl.bindVertexArray(view.triangles.array);
      if (!view.coloured) {
        gl.disableVertexAttribArray(meshProgram.attributes.values);
        continue;
      }
      const corners = new Float32Array(3 * values.length);  // each corner knows all three
      for (let i = 0; i < values.length; ++i) corners.set(values.subarray(i - i % 3, i - i % 3 + 3), 3 * i);
      gl.bindBuffer(gl.ARRAY_BUFFER, view.triangles.values);
      gl.bufferData(gl.ARRAY_BUFFER, corners, gl.STATIC_DRAW);
      bind(meshProgram.attributes.values, view.triangles.values);
    }
    if (colouring.palette) {
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, colouring.palette);
    }
    redraw();
  }

  function drawTriangles(triangles, look, colours) {
    const {uniforms} = meshProgram;
    gl.bindVertexArray(triangles.array);
    gl.uniform1i(uniforms.coloured, look.coloured);
    gl.uniform1i(uniforms.classes, look.classes);
    gl.uniform1i(uniforms.edges, look.edges);
    gl.uniform3fv(uniforms.plain, shade(look.plain));
    gl.uniform3fv(uniforms.inside, shade(look.inside));
    gl.uniform3fv(uniforms.edgeColour, shade(colours.edge));
    gl.drawArrays(gl.TRIANGLES, 0, triangles.count);
  }

  function draw(sharp) {
    pending = 0;
    if (sharp) canvas.dataset.sharp = 'yes';
    const scale = Math.min((window.devicePixelRatio || 1) * (sharp ? 2 : 1), kFinestScale);
    const outer = canvas.getBoundingClientRect();
    const [width, height] = [outer.width, outer.height].map((x) => Math.max(1, Math.round(x * scale)));
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const colouring = kColourings[element('colouring').value];
    const colours = dark.matches ? kDark : kLight;
    gl.enable(gl.SCISSOR_TEST);
    views.forEach((view, i) => {
      const place = element(`view-${i}`).getBoundingClientRect();
      const box = [place.left - outer.left, outer.bottom - place.bottom, place.width, place.height].map((x) => Math.round(x * scale));
      gl.viewport(...box);
      gl.scissor(...box);
      gl.clearColor(...shade(colours.stage), 1);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      const {toEye, toClip} = matrices(box[2], box[3]);
      for (const {program, uniforms} of [meshProgram, lineProgram]) {
        gl.useProgram(program);
        gl.uniformMatrix4fv(uniforms.toEye, false, toEye);
        gl.uniformMatrix4fv(uniforms.toClip, false, toClip);
      }
      gl.useProgram(meshProgram.program);
      gl.uniform1f(meshProgram.uniforms.scale, scale);
      drawTriangles(view.triangles, {
        coloured: view.coloured,
        classes: colouring.classes === true,
        edges: element('edges').checked,
        plain: colours.plain,
        inside: colours.inside,
      }, colours);
      if (colouring.gaps && gaps.length > 0) {
        gl.enable(gl.POLYGON_OFFSET_FILL);
        gl.polygonOffset(-2, -4);
        const look = {coloured: false, classes: false, edges: false, plain: kGapColour, inside: kGapColour};
        drawTriangles(gapTriangles, look, colours);
        gl.disable(gl.POLYGON_OFFSET_FILL);
      }
      if (element('curves').checked && view.lines.count > 0) {
        gl.useProgram(lineProgram.program);
        gl.bindVertexArray(view.lines.array);
        gl.uniform2f(lineProgram.uniforms.halfSize, box[2] / 2, box[3] / 2);
        gl.uniform1f(lineProgram.uniforms.halfWidth, 1.3 * scale);
        gl.uniform3fv(lineProgram.uniforms.plain, shade(colours.curve));
        gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, view.lines.count);
      }
    });
  }

  // --- Mouse, touch, keys ------------------------------------------------------------------------------------------------

  const kDegreesAPixel = 0.4, kDegreesAKey = 6, kMoveAKey = 0.04, kZoomAKey = 1.25;
  const pointers = new Map();

  const middleOf = (points) => ['x', 'y'].map((k) => points.reduce((sum, p) => sum + p[k], 0) / points.length);
  const spreadOf = (points) => points.length < 2 ? 0 : Math.hypot(points[0].x - points[1].x, points[0].y - points[1].y);

  stage.addEventListener('pointerdown', (event) => {
    stage.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, {x: event.clientX, y: event.clientY});
  });
  stage.addEventListener('pointermove', (event) => {
    if (!pointers.has(event.pointerId)) return;
    const before = [...pointers.values()].map((p) => ({...p}));
    pointers.set(event.pointerId, {x: event.clientX, y: event.clientY});
    const after = [...pointers.values()];
    const [[x0, y0], [x1, y1]] = [middleOf(before), middleOf(after)];
    const height = element('view-0').getBoundingClientRect().height;
    if (after.length > 1 || event.shiftKey || event.buttons > 1) {
      move((x1 - x0) / height, (y0 - y1) / height);
      if (spreadOf(before) > 0 && spreadOf(after) > 0) zoom(spreadOf(after) / spreadOf(before));
    } else {
      turn((x1 - x0) * kDegreesAPixel, (y1 - y0) * kDegreesAPixel);
    }
  });
  for (const end of ['pointerup', 'pointercancel', 'lostpointercapture']) {
    stage.addEventListener(end, (event) => pointers.delete(event.pointerId));
  }
  stage.addEventListener('contextmenu', (event) => event.preventDefault());
  stage.addEventListener('wheel', (event) => {
    event.preventDefault();
    const pixels = event.deltaY * [1, 16, 400][event.deltaMode];
    zoom(Math.exp(-0.0015 * Math.max(-400, Math.min(400, pixels))));
  }, {passive: false});

  stage.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;  // the browser's own
    const direction = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1]}[event.key];
    if (direction && event.shiftKey) move(kMoveAKey * direction[0], -kMoveAKey * direction[1]);
    else if (direction) turn(kDegreesAKey * direction[0], kDegreesAKey * direction[1]);
    else if (event.key === '+' || event.key === '=') zoom(kZoomAKey);
    else if (event.key === '-' || event.key === '_') zoom(1 / kZoomAKey);
    else if (event.key === '0' || event.key === 'Home') reset();
    else return;
    event.preventDefault();
  });

  element('controls').addEventListener('submit', (event) => event.preventDefault());
  element('colouring').addEventListener('change', setColouring);
  element('edges').addEventListener('change', redraw);
  element('curves').addEventListener('change', redraw);
  element('zoom-in').addEventListener('click', () => zoom(kZoomAKey));
  element('zoom-out').addEventListener('click', () => zoom(1 / kZoomAKey));
  element('reset').addEventListener('click', reset);
  dark.addEventListener('change', redraw);
  new ResizeObserver(redraw).observe(stage);
  canvas.addEventListener('webglcontextlost', () => giveUp('The graphics driver has taken its context away; reload the page.'));

  if (views.every((view) => view.curves.length === 0)) element('curves').disabled = true;
  setColouring();
  reset();
})();
