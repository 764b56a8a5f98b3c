// The mould of an actuator with the outline of the paper's: lengths in mm.
//
//   openscad -D 'part="cups"' -o cups.stl mould.scad
//
// From the authors' program: length, width, the heights above and below the neutral surface, the
// wall. The division into chambers is ours: it was not published.
// A test reads what stands in `name = number;`.

// "cups" (lower half of the upper mould), "core" (its upper half), "tray" (the base layer),
// "actuator" (what comes out of the first two)
part = "actuator";

// ---- Outline
length = 94;
width = 30;
height_above = 20;       // chambers, above the neutral surface
height_below = 4;        // base layer with paper and flex sensor
wall = 1.5;

// ---- Chambers
chambers = 11;
chamber_air = 3;         // inside, along the length
channel_width = 4;
channel_height = 3;

// ---- Mould
shell = 3;

// ---- What follows
chamber = chamber_air + 2 * wall;
gap = (length - chambers * chamber) / (chambers - 1);
air_ml = (chambers * chamber_air * (width - 2 * wall) * (height_above - wall)
          + (chambers - 1) * (gap + 2 * wall) * channel_width * channel_height) / 1000;
upper_ml = (chambers * chamber * width * height_above
            + (chambers - 1) * gap * width * (channel_height + wall)) / 1000 - air_ml;
base_ml = length * width * height_below / 1000;
echo(gap = gap, air_ml = air_ml, silicone_ml = upper_ml + base_ml);

function start(i) = i * (chamber + gap);

module outside() {
    for (i = [0 : chambers - 1]) translate([start(i), 0, 0]) cube([chamber, width, height_above]);
    cube([length, width, channel_height + wall]);
}
module inside(below = 0) {
    for (i = [0 : chambers - 1])
        translate([start(i) + wall, wall, -below])
            cube([chamber_air, width - 2 * wall, height_above - wall + below]);
    translate([wall, (width - channel_width) / 2, -below])
        cube([length - 2 * wall, channel_width, channel_height + below]);
}

// The upper part lies upside down in its cups; the open side looks up.
module cups() {
    difference() {
        translate([-shell, -shell, -shell])
            cube([length + 2 * shell, width + 2 * shell, height_above + shell]);
        translate([0, width, height_above]) rotate([180, 0, 0]) outside();
    }
}
// Hangs into the cups: what it fills becomes air.
module core() {
    translate([-shell, -shell, height_above])
        cube([length + 2 * shell, width + 2 * shell, shell]);
    translate([0, width, height_above]) rotate([180, 0, 0]) inside(0.01);
}
// For the base layer: half of it is poured, then paper and sensor, then the rest.
module tray() {
    difference() {
        translate([-shell, -shell, -shell])
            cube([length + 2 * shell, width + 2 * shell, height_below + shell]);
        cube([length, width, height_below + 1]);
    }
}

if (part == "cups") cups();
if (part == "core") core();
if (part == "tray") tray();
if (part == "actuator") difference() { outside(); translate([0, 0, -0.01]) inside(); }
