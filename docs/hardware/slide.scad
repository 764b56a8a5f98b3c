// The syringe slide. Lengths in mm, x along the syringe from the motor's face.
//
//   openscad -D 'part="carriage"' -o carriage.stl slide.scad
//   openscad -D 'part="sheet"' -o plates.svg slide.scad      (the plates' outlines, for cutting)
//
// A test compares the numbers with the firmware's: what stands in `name = number;` is read.

// "all", "motor_plate", "thrust_plate", "carriage", "syringe_plate", "saddle" or "sheet"
part = "all";
// Where the plunger stands in the drawing, from the retracted switch.
shown_mm = 0;

// ---- Screw and motor
steps_per_turn = 200;
microsteps = 16;
lead = 2;                // one start; the T8 screws of printers have four starts and 8 mm
screw = 8;
nut_body = 10.4;
nut_circle = 16;         // four M3

// ---- Syringe: measure yours
bore = 26.7;
barrel = 29.6;           // outside
barrel_flange = 4;       // thickness
flange_width = 52;
plunger_flange = 34;     // diameter
plunger_rest = 14;       // from flange to flange with the syringe empty
barrel_length = 130;     // from the flange's front to the nose

// ---- Travel from the retracted switch
stroke = 100;            // to an empty syringe
pushed_in_switch = 95;
hard_stop_behind = 2;

// ---- Frame
plate = 10;
motor_plate_thickness = 8;
screw_from = 26;         // in the coupling, 2 mm from the motor's shaft of 24 mm
thrust_plate_at = 40;
thrust_bearing = 5;      // F8-16M
collar = 9;
carriage_length = 45;    // LM8LUU
rod = 8;
rod_bearing = 15;        // outside of LM8LUU
rod_spacing = 74;
screw_below = 32;        // the screw's axis under that of syringe and rods
width = 100;
height = 92;             // from the base to the plates' upper edge
axis_height = 62;        // of syringe and rods above the base
base_length = 360;

// ---- What follows
retracted_at = thrust_plate_at + plate + thrust_bearing + collar + hard_stop_behind;
syringe_plate_at = retracted_at + carriage_length + stroke + plunger_rest;
microsteps_per_mm = steps_per_turn * microsteps / lead;
area = PI * bore * bore / 4;
ul_per_microstep = area / microsteps_per_mm;
syringe_ml = area * stroke / 1000;
rod_length = syringe_plate_at + plate;
screw_length = syringe_plate_at + 7 - screw_from;   // into the 608 bearing
echo(microsteps_per_mm = microsteps_per_mm, ul_per_microstep = ul_per_microstep,
     syringe_ml = syringe_ml, rod_length = rod_length, screw_length = screw_length,
     retracted_at = retracted_at, syringe_plate_at = syringe_plate_at);

$fn = 64;
clearance = 0.2;

// A plate's outline in y and z, its base at z = 0.
module outline() { translate([-width / 2, 0]) square([width, height]); }
module on_axis() { translate([0, axis_height]) children(); }
module rods(diameter) {
    on_axis() for (side = [-1, 1]) translate([side * rod_spacing / 2, 0])
        circle(d = diameter + clearance);
}
module on_screw() { translate([0, axis_height - screw_below]) children(); }
module around(circle_diameter, hole, start = 0) {
    for (turn = [0 : 3]) rotate(start + 90 * turn) translate([circle_diameter / 2, 0]) circle(d = hole);
}
module foot() { for (side = [-1, 1]) translate([side * 20, 5]) circle(d = 4.3); }

module motor_plate() {
    difference() {
        outline(); rods(rod); foot();
        on_screw() { circle(d = 22.5); around(31 * sqrt(2), 3.4, 45); }
    }
}
module thrust_plate() {
    difference() { outline(); rods(rod); foot(); on_screw() circle(d = screw + 1); }
}
module carriage() {
    difference() {
        translate([-width / 2, 12]) square([width, height - 12]);
        rods(rod_bearing);
        on_screw() { circle(d = nut_body); around(nut_circle, 3.4, 45); }
        // The plunger's flange is held by a plate with four M3 in front.
        on_axis() around(plunger_flange + 10, 2.8, 45);
    }
}
module syringe_plate() {
    difference() {
        outline(); rods(rod); foot();
        on_screw() circle(d = 22.1);                       // 608
        on_axis() { circle(d = barrel + 0.6); around(flange_width + 8, 4.3, 45); }
    }
}
module saddle() {
    difference() {
        translate([-width / 2, 0]) square([width, axis_height]);
        foot();
        on_axis() circle(d = barrel + 0.6);
    }
}

module along(at, thickness) {
    translate([at, 0, 0]) rotate([90, 0, 90]) linear_extrude(thickness) children();
}
module stick(at, length, diameter, side = 0, below = 0) {
    translate([at, side, axis_height - below]) rotate([0, 90, 0]) cylinder(d = diameter, h = length);
}

module all() {
    color("silver") translate([0, -20, -20]) cube([base_length, 40, 20]);
    along(0, motor_plate_thickness) motor_plate();
    along(thrust_plate_at, plate) thrust_plate();
    color("orange") along(retracted_at + shown_mm, carriage_length) carriage();
    along(syringe_plate_at, plate) syringe_plate();
    along(syringe_plate_at + plate + 70, plate) saddle();
    color("gray") for (side = [-1, 1]) stick(0, rod_length, rod, side * rod_spacing / 2);
    color("gray") stick(screw_from, screw_length, screw, 0, screw_below);
    color("lightblue", 0.5) stick(syringe_plate_at, barrel_length, barrel);
    color("white") stick(retracted_at + shown_mm + carriage_length,
                         plunger_rest + stroke, 12);
}

if (part == "all") all();
if (part == "motor_plate") linear_extrude(motor_plate_thickness) motor_plate();
if (part == "thrust_plate") linear_extrude(plate) thrust_plate();
if (part == "carriage") linear_extrude(carriage_length) carriage();
if (part == "syringe_plate") linear_extrude(plate) syringe_plate();
if (part == "saddle") linear_extrude(plate) saddle();
if (part == "sheet") {
    step = width + 10;
    motor_plate();
    translate([step, 0]) thrust_plate();
    translate([2 * step, 0]) syringe_plate();
    translate([3 * step, 0]) saddle();
    translate([4 * step, 0]) carriage();
}
