"""An example of each section of a configuration, for the page of all keys; a test loads each of them.

A section is named by its class; a line of dashes separates two examples. Together they have all its keys.
"""

EXAMPLES = {
    "Units": "units: {length: mm, stress: MPa, time: s}",
    "Reading": """\
trajectory: {kind: table, file: depth.txt, reading: {decimal: ",", columns: [time, depth, "-"], table: 2}}
---
trajectory: {kind: table, file: depth.txt, reading: {units: {depth: nm}}}
units: {length: um, stress: MPa, time: s}""",
    "GridKeys": """\
grid: {points: [512, 256], period: [2.0, 1.0]}
---
grid: {points: 512, boundary: isolated, datum: 2.0}
---
grid: {geometry: axisymmetric, points: 1024, extent: 2.0}
punch: {shape: sphere, radius: 5.0}""",
    "Layers": "body: {kind: layers}",
    "Anisotropic": """\
body: {kind: anisotropic, C11: 165.8, C12: 63.9, C44: 79.6, angle: 45}    # silicon, GPa; x along [110]
---
body: {kind: anisotropic, C11: 165.8, C12: 63.9, C44: 79.6, normal: [1, 1, 1], along: [1, -1, 0]}
---
body:    # 21 constants; a tenth of C11 couples shear along y and z with the stretch of x
  kind: anisotropic
  C: [
    [10, 4, 4, 1, 0, 0], [4, 10, 4, 0, 0, 0], [4, 4, 10, 0, 0, 0],
    [1, 0, 0, 3, 0, 0], [0, 0, 0, 0, 3, 0], [0, 0, 0, 0, 0, 3],
  ]
---
body: {kind: anisotropic, C11: 163, C12: 34.8, C13: 51.6, C33: 181, C44: 57.3, C66: 64.1,
  material: {model: zener, G0: 1, Ginf: 2, tau: 1.0}}""",
    "Lattice": """\
grid: {points: [64, 64], period: 64.0}
body: {kind: lattice, crystal: fcc, nearest: 1.0, spacing: 1.0}
---
grid: {points: 128, period: 64.0}
body: {kind: lattice, crystal: simple_cubic, nearest: 1.0, next_nearest: 0.5, spacing: 0.5, layers: 20,
  material: {model: zener, G0: 1, Ginf: 2, tau: 1.0}}""",
    "Tabulated": """\
body: {kind: table, table: stiffness.txt, mean: 0.0, material: {model: zener, G0: 1, Ginf: 5, tau: 1.0}}
---
grid: {points: 8, period: 2.0}
body: {kind: table, table: stiffness.npy, period: 2.0}    # K at the waves of the grid""",
    "BodyFile": "body: {file: bed.py, kind: file, k: 5.0}    # k is a field of the class in bed.py",
    "StackedLayer": """\
layers:
  - {thickness: 0.01, poisson: 0.45, material: {G0: 5.0, Ginf: 20.0}}
  - {thickness: 0.1, poisson: 0.49, material: {G0: 1.0, Ginf: 4.0}}""",
    "Layer": "layer: {thickness: 0.1, poisson: 0.49, material: {G0: 1.0, Ginf: 5.0}}",
    "Zener": "layer: {material: {model: zener, moduli: young, G0: 3.0, Ginf: 15.0, tau: 2.0}}",
    "Prony": """\
layer: {material: {model: prony, G0: 1.0, branches: [{G: 6.0, tau: 0.1}, {G: 3.0, tau: 9.0}]}}
---
layer: {poisson: 0.4, material: {model: prony, moduli: bulk, G0: 1.0, branches: [{G: 6.0, tau: 0.1}]}}""",
    "Branch": "layer: {material: {model: prony, branches: [{G: 6.0, tau: 0.1}]}}",
    "Elastic": """\
layer: {material: {model: elastic, G: 3.0}}
---
layer: {poisson: 0.4, material: {model: elastic, young: 8.4}}
---
layer: {poisson: 0.4, material: {model: elastic, bulk: 14.0}}
---
layer: {poisson: 0.4, material: {model: elastic, moduli: young, G: 8.4}}    # as young: 8.4""",
    "FractionalZener": """\
layer:
  material: {model: fractional_zener, moduli: shear, G0: 1, Ginf: 50, tau: 1.0, exponent: 0.5,
    tolerance: 0.001}""",
    "PowerLaw": """\
layer:
  material: {model: power_law, moduli: young, G0: 0.1, G: 1.0, tau: 1.0, exponent: 0.3, tolerance: 1.0e-3}""",
    "Kohlrausch": """\
layer:
  material: {model: kohlrausch, moduli: young, G0: 3, Ginf: 30, tau: 1.0, exponent: 0.5, tolerance: 0.001}""",
    "HavriliakNegami": """\
layer:
  material: {model: havriliak_negami, moduli: young, G0: 3, Ginf: 50, tau: 1, alpha: 0.6, gamma: 0.5,
    tolerance: 0.001}""",
    "MaterialFile": "layer: {material: {file: rubber.yaml}}",
    "WLF": """\
layer: {material: {G0: 1.0, Ginf: 10.0, shift: {law: wlf, reference: 20, C1: 17.4, C2: 51.6}}}
temperature: {value: 35}""",
    "Arrhenius": """\
layer: {material: {G0: 1.0, Ginf: 10.0, shift: {law: arrhenius, reference: 20, activation_energy: 8.0e+4}}}
temperature: {value: 35}""",
    "Halfspace": """\
halfspace: {shear_modulus: 10.0, poisson: 0.3}
---
halfspace: {poisson: 0.3, material: {G0: 20.0, Ginf: 30.0}}
---
halfspace: {poisson: 0.3, young_modulus: 26.0}
---
halfspace: {poisson: 0.3, bulk_modulus: 22.0}""",
    "Counterbody": """\
counterbody: {layer: {thickness: 0.05, material: {G0: 2.0, Ginf: 8.0}}, halfspace: {shear_modulus: 50.0}}
---
trajectory: {velocity: 0.1}
counterbody: {layer: {thickness: 0.05}, halfspace: {shear_modulus: 50}, velocity_ratio: 1.0}  # it rolls""",
    "Temperature": """\
temperature: {value: 35}
layer: {material: {shift: {law: wlf, reference: 20, C1: 17.4, C2: 51.6}}}
---
temperature: {file: celsius.txt}
layer: {material: {shift: {law: wlf, reference: 20, C1: 17.4, C2: 51.6}}}""",
    "Parabola": """\
punch: {shape: parabola, radius: 0.25}
---
grid: {points: [256, 256]}
punch: {shape: parabola, radius: [0.25, 0.5]}""",
    "Sphere": "punch: {shape: sphere, radius: 0.6}",
    "Cylinder": """\
grid: {points: [256, 256]}
punch: {shape: cylinder, radius: 0.6, along: x}""",
    "Cone": "punch: {shape: cone, slope: 0.1}",
    "Wedge": """\
grid: {points: [256, 256]}
punch: {shape: wedge, slope: 0.1, along: x}""",
    "Pyramid": """\
grid: {points: [256, 256]}
punch: {shape: pyramid, angle: 68.0, faces: 4}""",
    "Flat": "punch: {shape: flat, width: 0.1, edge_radius: 0.05}",
    "BluntedCone": "punch: {shape: blunted_cone, slope: 0.1, tip_radius: 0.5}",
    "Array": "punch: {shape: array, element: {shape: parabola, radius: 0.1}, counts: 4}",
    "Sinusoid": "punch: {shape: sinusoid, amplitude: 0.005, wavelength: 0.5}",
    "SelfAffine": """\
grid: {points: [256, 256]}
punch: {shape: self_affine, hurst: 0.8, short_cutoff: 0.02, roll_off: 0.25, long_cutoff: 0.5,
  rms_slope: 0.1, seed: 1}
---
grid: {points: [256, 256]}
punch: {shape: self_affine, hurst: 0.8, short_cutoff: 0.02, rms_height: 0.002, seed: 1}""",
    "Profile": """\
grid: {points: 512}
punch: {shape: profile, file: heights.txt, touches_first: lowest, hole: none, reading: {decimal: "."}}""",
    "Topography": """\
grid: {points: [256, 256], period: 0.2}
punch: {shape: topography, file: surface.h5, dataset: scan/height, unit: 1.0e-3, fill: membrane,
  detrend: plane, taper: 0.1, resample: fourier}
---
units: {length: um, stress: MPa, time: s}
grid: {points: [256, 256], period: [10.0, 8.0]}
punch: {shape: topography, file: scan.txt, unit: nm, size: [10.0, 8.0], transpose: true, hole: -9999,
  fill: membrane, reading: {decimal: ","}}""",
    "FlatPunch": """\
grid: {geometry: axisymmetric}
punch: {shape: flat_punch, radius: 0.5}""",
    "RadialProfile": """\
grid: {geometry: axisymmetric}
punch: {shape: radial_profile, file: profile.txt}""",
    "HardWall": "interface: {law: hard_wall}\n---\ninterface: {law: hard_wall, hardness: 0.3}",
    "Exponential": "interface: {law: exponential, work: 2.0e-4, range: 1.0e-3}",
    "Dugdale": "interface: {law: dugdale, work: 2.0e-4, stress: 0.2, smoothing: 0.1}",
    "LennardJones": "interface: {law: lennard_jones, work: 2.0e-4, separation: 1.0e-3}",
    "Electrostatic": """\
interface: {law: electrostatic, voltage: 600.0, insulation: 3.0e-6, permittivity: 8.854e-12}""",
    "ShortRange": """\
grid: {geometry: axisymmetric}
interface: {law: short_range, work: 1.0e-3, edge_speed: 0.1, edge_exponent: 0.6, healing_work: 0}""",
    "Coulomb": """\
interface: {law: coulomb, coefficient: 0.4}
---
interface: {law: coulomb, coefficient: friction.txt}    # two columns, slip speed and coefficient""",
    "ShearStrength": """\
interface: {law: shear_strength, stress: 0.05}
---
interface: [{law: coulomb, coefficient: 0.4}, {law: shear_strength, stress: 0.05}]    # the smaller one""",
    "Tangential": """\
interface: {law: coulomb, coefficient: 0.4}
trajectory:
  tangential: {control: displacement, kind: ramp, displacement: 0.002, start: 1.0, ramp_time: 1.0}
---
grid: {points: [128, 128]}
interface: {law: coulomb, coefficient: 0.4}
trajectory:
  control: load
  load: 0.01
  tangential: {control: force, kind: oscillation, force: 0.002, start: 1, period: 2, cycles: 3, direction: 30}
---
interface: {law: coulomb, coefficient: 0.4}
trajectory:
  tangential: {kind: table, file: displacement.txt}
---
interface: {law: coulomb, coefficient: 0.4}
trajectory: {velocity: 0.1, creepage: 0.005}
time: {step: 0.0005, end: 0.5}""",
    "Creepages": """\
grid: {points: [64, 64]}
interface: {law: coulomb, coefficient: 0.4}
trajectory: {control: load, load: 0.02, velocity: 0.1, creepage: {x: 0.005, y: 0.001, spin: 0.1}}
time: {steady: at_once}
---
grid: {points: [64, 64]}
interface: {law: coulomb, coefficient: 0.4}
trajectory: {control: load, load: 0.02, velocity: 0.1, creepage: {spin: 0.1},
  tangential: {control: force, force: 0.002}}
time: {steady: at_once}""",
    "Insulator": """\
units: {length: m, stress: Pa, time: s}
interface: {law: electrostatic, voltage: 600.0, insulation: [{thickness: 1.0e-5, permittivity: 3.0}]}""",
    "Trajectory": """\
trajectory: {control: depth, kind: ramp_hold, depth: 0.01, ramp_time: 1.0}
---
trajectory: {control: load, load: 0.02, ramp_time: 0.1, velocity: 0.1}
---
trajectory: {control: gap, gap: 0.1}
---
trajectory: {control: force, force: 0.02, velocity_file: velocity.txt}
---
trajectory: {kind: approach_retract, start: 0.0, depth: 0.01, approach_speed: 0.01, dwell: 5.0,
  retract_speed: 0.02, final: 0.0, cycles: 3}
---
trajectory: {kind: table, file: depth.txt}
---
interface: {law: coulomb, coefficient: 0.4}
trajectory: {velocity: 0.1, creepage: 0.005}
time: {end: 0.5, step: adaptive}""",
    "Time": """\
time: {end: 20.0, step: adaptive, integrator: exponential, tolerance: 1.0e-4}
---
trajectory: {velocity: 0.1}
time: {end: 400.0, step: adaptive, steady: 1.0e-3}
---
interface: {law: coulomb, coefficient: 0.4}
trajectory: {control: load, load: 0.02, velocity: 0.1, creepage: 0.005}
time: {steady: at_once}""",
    "SolverKeys": """\
solver: {method: fire, inertia: uniform, tolerance: 1.0e-6, max_iterations: 100000}""",
    "Output": """\
time: {step: adaptive}
output: {snapshots: [1.0, 8.0], times: 0.1, patches: true, keep_state: true}
---
grid: {points: [64, 64]}
output: {observables: [critical_gap_x, critical_gap_y, flow_bruggeman, spot_radius]}""",
    "Leakage": """\
grid: {points: [64, 64]}
output: {leakage: {every: 10}}""",
    "Conductance": """\
output:
  conductance: {body: {resistivity: 1.7e-8}, punch: {resistivity: 5.0e-8}, every: 2}""",
    "Conductor": """\
output:
  conductance:
    body: {resistivity: 0.0, films: [{thickness: 1.0e-3, resistivity: 2.0}]}
    punch: {resistivity: .inf, films: [{thickness: 0.1, resistivity: 1.0}]}""",
    "Film": "output: {conductance: {body: {films: [{thickness: 1.0e-3, resistivity: 2.0}]}}}",
    "Stiffness": "output: {stiffness: {frequencies: [0, 1.0, 100.0, .inf], every: 5}}",
    "Inside": """\
output: {snapshots: [1.0, 8.0], inside: {depths: [0, 0.02, 0.05, 0.2], times: [8.0]}}
---
output: {inside: {points: 20, every: 10}}""",
    "Histograms": "output: {histograms: {pressure: {max: 10.0}, gap: {max: 0.1}}}",
    "PressureHistogram": "output: {histograms: {pressure: {scale: log, min: 1.0e-3, max: 10.0, bins: 50}}}",
    "GapHistogram": "output: {histograms: {gap: {scale: log, min: 1.0e-5, max: 0.1, bins: 50}}}",
    "MomentsBetween": """\
time: {step: adaptive}
output:
  snapshots: {from: start, to: peak, points: 5}
  times: {from: 0.01, to: end, points: 50, spacing: log}""",
    "Sweep": """\
sweep: {layer.thickness: [0.02, 0.1, .inf], halfspace.shear_modulus: [1, 10]}""",
    "Zip": """\
sweep:
  zip: {layer.thickness: [0.02, 0.05, 0.1], punch.radius: [0.1, 0.25, 0.5]}""",
    "Spaced": """\
sweep: {layer.material.Ginf: {from: 2.0, to: 50.0, points: 5, spacing: log}}""",
    "Samples": """\
sweep:
  latin_hypercube: {samples: 100, seed: 7, layer.thickness: {from: 0.01, to: 1.0, scale: log}}
---
sweep:
  sobol: {samples: 64, seed: 7, layer.material.Ginf: {from: 2.0, to: 50.0}}""",
    "Range": """\
sweep:
  latin_hypercube: {samples: 100, layer.thickness: {from: 0.01, to: 1.0, scale: log}}""",
}
