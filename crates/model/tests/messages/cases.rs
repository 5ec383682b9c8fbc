//! What is put in the place of a piece of a good model, and the message that follows.

/// What is replaced, by what, and what is said, with line and column.
pub(crate) const CASES: &[(&str, &str, &str)] = &[
    ("name = \"test\"", "name = \"test", "line 2, column 13: invalid basic string, expected `\"`"),
    (
        "name = \"test\"",
        "name = \"test\"\nname = \"twice\"",
        "line 3, column 1: `name` stands here for the second time: remove one of them",
    ),
    (
        "schema = 2\n",
        "",
        "line 1, column 1: schema is missing, but a flight model has schema 2: write `schema = 2`",
    ),
    (
        "schema = 2",
        "schema = 1",
        "line 1, column 10: schema is 1, but a flight model has schema 2: write `schema = 2`",
    ),
    ("[forces]", "[force]", "line 20, column 2: `force` is no key of the file: did you mean forces, source?"),
    (
        "initial = \"omega\"",
        "inital = \"omega\"",
        "line 18, column 63: `inital` is no key of state speed: did you mean initial?",
    ),
    (
        "derivative = \"(omega - speed)/tau\", ",
        "",
        "line 18, column 1: state speed has no `derivative`: add it",
    ),
    ("value = 0.1 }", "}", "line 10, column 5: parameter d has no `value`: add it"),
    ("std = 0.1", "text = \"no deviation\"", "line 25, column 7: output acc has no `std`: add it"),
    ("measured = \"force_x\"\n", "", "line 36, column 1: [[equation]] has no `measured`: add it"),
    (
        "x = \"-d*u\"",
        "x = true",
        "line 21, column 5: `x` must be an expression or a number, but is true or false",
    ),
    (
        "x = \"-d*u\"",
        "x = { value = \"-d*u\" }",
        "line 21, column 5: `x` must be an expression or a number, but is a table",
    ),
    (
        "min = 0, max = 400",
        "min = \"0\", max = 400",
        "line 5, column 33: `min` must be a number, but is text",
    ),
    (
        "I_xx = { free = true }",
        "I_xx = { free = \"yes\" }",
        "line 11, column 17: `free` must be true, false, or one of { moved = [\"...\"] } and { unless_moved = [\"...\"] }, but is text",
    ),
    (
        "I_xx = { free = true }",
        "I_xx = { free = {} }",
        "line 11, column 17: `free` must be true, false, or one of { moved = [\"...\"] } and { unless_moved = [\"...\"] }, but is empty",
    ),
    (
        "I_xx = { free = true }",
        "I_xx = { free = { moved = [\"omegga\"] } }",
        "line 11, column 27: `omegga` is not defined: did you mean omega?",
    ),
    (
        "I_xx = { free = true }",
        "I_xx = { free = true, value = 3e-3 }",
        "line 11, column 23: the value of `I_xx` comes from the vehicle file: remove it here",
    ),
    (
        "I_xx = { free = true }",
        "I_xx = { free = true, unit = \"kg m\" }",
        "line 11, column 8: I_xx is kg m^2, this is kg m: a factor in m is missing, or a declared unit is wrong",
    ),
    (
        "measured = \"force_x\"",
        "measured = \"force\"",
        "line 38, column 12: `measured` must be force_x, force_y, force_z, moment_x, moment_y or moment_z, but is `force`",
    ),
    (
        "when = \"excited\"",
        "when = \"moved\"",
        "line 41, column 8: `when` must be always or excited, but is `moved`",
    ),
    (
        "fixed = { u = -0.1 }",
        "fixed = { v = -0.1 }",
        "line 40, column 11: `v` is no key of `fixed` of X, which takes its regressors: did you mean 1, u?",
    ),
    (
        "thrust = { unit = \"N\", value",
        "\"2 thrust\" = { unit = \"N\", value",
        "line 14, column 1: `2 thrust` is no name: begin with a letter, go on with letters, digits and _, at most 60",
    ),
    (
        "lift = { unit",
        "u = { unit",
        "line 15, column 1: `u` is already a name of the format: take another name",
    ),
    ("lift = { unit", "omega = { unit", "line 15, column 1: `omega` is already an input: take another name"),
    ("lift = { unit", "sin = { unit", "line 15, column 1: `sin` is already a function: take another name"),
    (
        "lift = { unit",
        "a_x = { unit",
        "line 15, column 1: `a_x` is already a name of the format: take another name",
    ),
    (
        "label = \"drag\"",
        "label = \"tau\"",
        "line 9, column 1: `tau` is already name or label of the parameter d: take another name",
    ),
    (
        "unit = \"N s/m\"",
        "unit = \"N s/mm\"",
        "line 10, column 30: `mm` is no unit: write m; units are products of m kg s A K N J W Pa Hz V C rad 1, such as \"N m s/rad\"",
    ),
    (
        "unit = \"m/s^2\"",
        "unit = \"deg\"",
        "line 25, column 16: `deg` is no unit: write rad; units are products of m kg s A K N J W Pa Hz V C rad 1, such as \"N m s/rad\"",
    ),
    (
        "unit = \"N s/m\"",
        "unit = \"N/(m/s)\"",
        "line 10, column 30: `(m` is no unit: write each divisor with its own `/`, without parentheses; units are products of m kg s A K N J W Pa Hz V C rad 1, such as \"N m s/rad\"",
    ),
    (
        "unit = \"rad/s\", derivative",
        "unit = \"rpm\", derivative",
        "line 18, column 18: `rpm` is no unit: write rad/s; units are products of m kg s A K N J W Pa Hz V C rad 1, such as \"N m s/rad\"",
    ),
    ("x = \"-d*u\"", "x = \"-1.2.3*u*d\"", "line 21, column 7: `1.2.3` is no number: write 0.05 or 5e-2"),
    ("value = 0.05", "value = inf", "line 9, column 29: `value` is inf, but must be a finite number"),
    (
        "value = 0.05",
        "value = 5",
        "line 9, column 29: `the value of tau` is 5, but must be between its min and its max",
    ),
    ("max = 1 }", "max = 1e-4 }", "line 9, column 7: `max of tau` is 0.0001, but must be above min"),
    ("std = 0.1", "std = 0", "line 25, column 46: `std` is 0, but must be above zero"),
    (
        "free = true, min",
        "prior_std = -1, free = true, min",
        "line 9, column 47: `prior_std` is -1, but must be above zero",
    ),
    (
        "x = \"-d*u\"",
        "x = \"-d*u u\"",
        "line 21, column 11: `u` does not belong here: an operator or a comma is missing before it",
    ),
    (
        "x = \"-d*u\"",
        "x = \"-d*(u + 1\"",
        "line 21, column 15: the expression ends here: a name, a number or a `)` is missing",
    ),
    (
        "x = \"-d*u\"",
        "x = \"-d*u)\"",
        "line 21, column 10: `)` does not belong here: a value, or the `(` of this, is missing before it",
    ),
    (
        "x = \"-d*u\"",
        "x = \"-d*\"",
        "line 21, column 9: the expression ends here: a name, a number or a `)` is missing",
    ),
    (
        "x = \"-d*u\"",
        "x = \"\"",
        "line 21, column 6: the expression ends here: a name, a number or a `)` is missing",
    ),
    (
        "x = \"-d*u\"",
        "x = \"d*u > 0\"",
        "line 21, column 10: `>` does not belong here: there are no comparisons; use min, max, clamp or a table",
    ),
    ("x = \"-d*u\"", "x = \"-d*u*2µ$\"", "line 21, column 13: `$` does not belong here"),
    (
        "x = \"-d*u\"",
        "x = \"(((((((((((((((((((((((((((((((((((((((((((((((((((((((((((((u)))))))))))))))))))))))))))))))))))))))))))))))))))))))))))))\"",
        "line 21, column 66: more than 60 parentheses or definitions within each other: split the expression into definitions",
    ),
    (
        "x = \"-d*u\"",
        "x = \"-d*u*thurst\"",
        "line 21, column 11: `thurst` is not defined: did you mean thrust?",
    ),
    (
        "x = \"-d*u\"",
        "x = \"-d*velocity_of_the_air\"",
        "line 21, column 9: `velocity_of_the_air` is not defined: give it under [parameters], [inputs] or [definitions]",
    ),
    (
        "x = \"-d*u\"",
        "x = \"-d*u*sen(u)\"",
        "line 21, column 11: there is no function `sen`: did you mean sin, asin?",
    ),
    (
        "x = \"-d*u\"",
        "x = \"-d*u*atan2(u)\"",
        "line 21, column 11: `atan2` takes 2 arguments, but has 1: write `atan2(y, x)`",
    ),
    (
        "x = \"-d*u\"",
        "x = \"-d*u*sin(1, 2)\"",
        "line 21, column 11: `sin` takes one argument, but has 2: write `sin(x)`",
    ),
    (
        "x = \"-d*u\"",
        "x = \"-d*u*thrust_curve\"",
        "line 21, column 11: `thrust_curve` takes one argument, but has 0: write `thrust_curve(x)`",
    ),
    (
        "x = \"-d*u\"",
        "x = \"-d*u - a_x*mass\"",
        "line 21, column 13: `a_x` may not be used in forces, moments, states and definitions, which give the accelerations: use it in [outputs]",
    ),
    (
        "trim = \"sqrt(mass*g/k_T)\"",
        "trim = \"sqrt(mass*g/k_T) + speed\"",
        "line 5, column 74: `speed` may not be used in the trim of omega, which may use parameters alone",
    ),
    (
        "initial = \"omega\"",
        "initial = \"omega + q\"",
        "line 18, column 82: `q` may not be used in the initial value of speed, which may use inputs and parameters alone",
    ),
    (
        "value = \"d/k_T\"",
        "value = \"thrust/k_T\"",
        "line 28, column 20: `thrust` may not be used in `ratio`, which may use parameters alone",
    ),
    (
        "value = \"k_T*speed^2\"",
        "value = \"k_T*speed^2 + (lift - lift*u)\"",
        "line 14, column 32: this goes in a circle: thrust needs lift needs thrust; give one of them without the others",
    ),
    (
        "value = 0.1 }",
        "value = \"d\" }",
        "line 10, column 1: this goes in a circle: d needs d; give one of them without the others",
    ),
    (
        "x = \"-d*u\"",
        "x = \"-d*u*tau\"",
        "line 21, column 6: x of [forces] is N, this is N s: a factor in 1/s is missing, or a declared unit is wrong",
    ),
    (
        "z = \"-lift - d*w + thrust\"",
        "z = \"-lift - d*w*tau + thrust\"",
        "line 22, column 14: z of [forces] is N, this is N s: a factor in 1/s is missing, or a declared unit is wrong",
    ),
    (
        "z = \"-lift - d*w + thrust\"",
        "z = \"-(lift*tau + d*w) + thrust\"",
        "line 22, column 8: z of [forces] is N, this is N s: a factor in 1/s is missing, or a declared unit is wrong",
    ),
    (
        "z = \"-lift - d*w + thrust\"",
        "z = \"-lift + 2*(thrust + d)\"",
        "line 22, column 26: the sum before this term is N, this is N s/m: a factor in m/s is missing, or a declared unit is wrong",
    ),
    (
        "z = \"-lift - d*w + thrust\"",
        "z = \"-lift - d*w + thrust*sin(speed)\"",
        "line 22, column 31: the argument of `sin` is without unit, this is 1/s: a factor in s is missing, or a declared unit is wrong",
    ),
    (
        "z = \"-lift - d*w + thrust\"",
        "z = \"-lift - d*w + thrust^mass\"",
        "line 22, column 27: an exponent is without unit, this is kg: a factor in 1/kg is missing, or a declared unit is wrong",
    ),
    (
        "z = \"-lift - d*w + thrust\"",
        "z = \"-lift - d*w + thrust*u^(speed/omega)\"",
        "line 22, column 27: the base of an exponent that is no number is without unit, this is m/s: a factor in s/m is missing, or a declared unit is wrong",
    ),
    (
        "z = \"-lift - d*w + thrust\"",
        "z = \"-lift - d*w + min(thrust, d)\"",
        "line 22, column 32: what stands before in `min` is N, this is N s/m: a factor in m/s is missing, or a declared unit is wrong",
    ),
    (
        "derivative = \"(omega - speed)/tau\"",
        "derivative = \"omega - speed\"",
        "line 18, column 41: the derivative of speed is 1/s^2, this is 1/s: a factor in 1/s is missing, or a declared unit is wrong",
    ),
    (
        "thrust_curve(1)\"",
        "thrust_curve(1)*u\"",
        "line 15, column 40: `lift` is N, this is N m/s: a factor in s/m is missing, or a declared unit is wrong",
    ),
    (
        "[definitions]",
        "spare = { value = 1 }\n[definitions]",
        "line 13, column 1: the parameter `spare` appears in no force, moment, state, output or other parameter: use it or remove it",
    ),
    (
        "[forces]\nx = \"-d*u\"\nz = \"-lift - d*w + thrust\"\n",
        "",
        "line 1, column 1: the model has no force and no moment: give [forces] or [moments]",
    ),
    (
        "x = [0, 1, 2]",
        "x = [0, 2, 2]",
        "line 30, column 1: table `thrust_curve` needs as many y as x, at least two, finite, x increasing",
    ),
    (
        "x = [0, 1, 2]",
        "x = [0, 1]",
        "line 30, column 1: table `thrust_curve` needs as many y as x, at least two, finite, x increasing",
    ),
    (
        "value = \"k_T*speed^2\"",
        "value = \"\"\"\n  k_T*speed^2\n  + thrust_curve(1)*tau\"\"\"",
        "line 16, column 5: `thrust` is N, this is N s: a factor in 1/s is missing, or a declared unit is wrong",
    ),
    (
        "value = \"k_T*speed^2\"",
        "value = \"k_T*\\u0073peed^2*q\"",
        "line 14, column 32: `thrust` is N, this is N/s: a factor in s is missing, or a declared unit is wrong",
    ),
];
