// @@TITLE
#ifndef PINFRIC_SCENE_HPP
#define PINFRIC_SCENE_HPP

#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__)
#error "pinfric: -ffast-math takes away the checks for NaN; compile this header without it"
#endif

#include <cmath>
#include <limits>

namespace pinfric_scene {

constexpr double inf = std::numeric_limits<double>::infinity();

// ------------------------------------------------------------------ what the constants mean
// The axes of a body are those in which the axis of its joint is z. Wrenches are force, then moment.

struct Body {
  int parent;              // -1: the ground
  bool turns;              // else its joint slides
  int freedom;             // that its joint, or the joint that it mimics, follows
  double ratio, shift;     // joint position = ratio * position of the freedom + shift
  double rotation[9];      // of these axes in the parent's at joint position 0, by rows
  double position[3];      // of the joint's origin in the parent's axes (m)
  double turn[9];          // from the axes of the robot's description to these, by rows
  double mass, com[3];     // kg, m
  double inertia[6];       // about the centre of mass: xx xy xz yy yz zz (kg m^2)
};
struct Site {              // a joint with friction; per rad/s where it turns, per m/s where it slides
  int body, freedom;
  double ratio;            // its velocity per velocity of the freedom
  double mu_static, mu_kinetic;
  double coulomb_static[2], coulomb_kinetic[2];  // against forward, backward motion (N m or N)
  double viscous, stick_velocity;
  double load;             // constant part of the normal load (N m or N)
  int first_term, last_term, first_row, last_row;
};
struct Term {              // of a normal load: |(map + s moved) wrench|, s the displacement
  int components;
  bool moves;
  double map[3][6], moved[3][6];
};
struct Row {               // of friction in motion: speed^power exp(-(speed / velocity)^exponent)
  double mu, coulomb[2], power, velocity, exponent;
};
struct Drive {             // with its gear; torques at the joint (N m or N)
  double ratio;            // turns of the motor per turn of the joint
  double rotor_inertia;    // at the motor's shaft (kg m^2)
  double viscous, power;   // of the motor's friction, N m (s/rad)^power at its shaft
  double stick_velocity;
  double no_load[2], no_load_static[2];          // forward, backward
  double constant[2], rise[2], exponent[2];      // factor on the loss: motor drives, is driven
  int first[2], last[2];                         // lines of the loss, the same two
};
struct Line { double load, loss, slope; };       // where a line of a gear's loss begins
struct Frame { int body; double rotation[9], position[3]; };  // in the body's axes

// ------------------------------------------------------------------ constants of the robot

// @@CONSTANTS

// ------------------------------------------------------------------ what a controller sees

// How the compensation behaves; one number per drive.
struct Options {
  double scale[Robot::drives];            // of dry friction and gear losses: at most 1/(1 + e)
  double viscous_scale[Robot::drives];    // of friction that vanishes at rest
  double switch_velocity[Robot::drives];  // band in which the direction changes (rad/s or m/s)
  double hold_error[Robot::drives];       // position error that asks for all of break-away; 0: off
  double limit[Robot::drives];            // of the compensation (N m or N)
  double power[Robot::drives];            // it may inject beyond friction (W); inf: not watched

  Options() noexcept {
    for (int d = 0; d < Robot::drives; ++d) {
      scale[d] = viscous_scale[d] = 0.8;
      switch_velocity[d] = 0.02;
      hold_error[d] = 0.0;
      limit[d] = default_limit[d];
      power[d] = inf;
    }
  }
};

// All that follows from one state. Efforts are the drives' at the joints (N m or N).
struct Instant {
  double effort_frictionless[Robot::drives];
  double wrench[Robot::sites > 0 ? Robot::sites : 1][6];  // parent on child, in the child's frame
  double normal_load[Robot::sites > 0 ? Robot::sites : 1];
  double friction_lower[Robot::sites > 0 ? Robot::sites : 1];  // of the parent on the child
  double friction_upper[Robot::sites > 0 ? Robot::sites : 1];
  bool sticking[Robot::sites > 0 ? Robot::sites : 1];
  double effort_lower[Robot::drives], effort_upper[Robot::drives];
  double motor_torque_lower[Robot::drives], motor_torque_upper[Robot::drives];  // N m at the shaft
};

// ------------------------------------------------------------------ the laws

namespace detail {

struct Vector { double x, y, z; };

inline Vector cross(const Vector& a, const Vector& b) noexcept {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline Vector sum(const Vector& a, const Vector& b) noexcept {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
inline Vector turned(const double* R, const Vector& a) noexcept {  // R a, R by rows
  return {R[0] * a.x + R[1] * a.y + R[2] * a.z, R[3] * a.x + R[4] * a.y + R[5] * a.z,
          R[6] * a.x + R[7] * a.y + R[8] * a.z};
}
inline Vector turned_back(const double* R, const Vector& a) noexcept {  // R^T a
  return {R[0] * a.x + R[3] * a.y + R[6] * a.z, R[1] * a.x + R[4] * a.y + R[7] * a.z,
          R[2] * a.x + R[5] * a.y + R[8] * a.z};
}
inline Vector times(const double* I, const Vector& a) noexcept {  // I: xx xy xz yy yz zz
  return {I[0] * a.x + I[1] * a.y + I[2] * a.z, I[1] * a.x + I[3] * a.y + I[4] * a.z,
          I[2] * a.x + I[4] * a.y + I[5] * a.z};
}
inline bool finite(const double* values, int count) noexcept {
  double zero = 0.0;
  for (int i = 0; i < count; ++i) zero += values[i] - values[i];  // NaN of NaN and inf
  return zero == 0.0;
}
inline void clear(double* values, int count) noexcept {
  for (int i = 0; i < count; ++i) values[i] = 0.0;
}
inline double sign(double x) noexcept { return x > 0.0 ? 1.0 : (x < 0.0 ? -1.0 : 0.0); }
inline double smooth_sign(double x) noexcept {  // sign(x) for |x| >= 1, C1
  if (x >= 1.0) return 1.0;
  if (x <= -1.0) return -1.0;
  return 0.5 * x * (3.0 - x * x);
}
inline double bell(double x) noexcept {  // 1 at 0, 0 for |x| >= 1, C1
  const double rest = 1.0 - x * x;
  return rest > 0.0 ? rest * rest : 0.0;
}
inline double power_of(double speed, double power) noexcept {  // straight below 1e-6 where steep
  if (power == 1.0) return speed;
  if (power < 1.0 && speed < 1e-6) return speed * std::pow(1e-6, power - 1.0);
  return std::pow(speed, power);
}

// Friction of a site in motion but for `viscous`: dry and drag, against forward and backward motion.
struct Moving { double mu, coulomb[2], drag_mu, drag[2]; };

inline Moving friction_at(const Site& site, double speed) noexcept {
  Moving now = {site.mu_kinetic, {site.coulomb_kinetic[0], site.coulomb_kinetic[1]}, 0.0, {0.0, 0.0}};
  for (int r = site.first_row; r < site.last_row; ++r) {
    const Row& row = rows[r];
    double shape = 1.0;
    if (row.velocity < inf) shape = std::exp(-std::pow(speed / row.velocity, row.exponent));
    if (row.power > 0.0) {
      shape *= power_of(speed, row.power);
      now.drag_mu += row.mu * shape;
      now.drag[0] += row.coulomb[0] * shape;
      now.drag[1] += row.coulomb[1] * shape;
    } else {
      now.mu += row.mu * shape;
      now.coulomb[0] += row.coulomb[0] * shape;
      now.coulomb[1] += row.coulomb[1] * shape;
    }
  }
  return now;
}

// Friction of a site that vanishes at rest, along its velocity v: viscous v + sign(v) drag(|v|).
inline double drag_of(const Site& site, const Moving& now, double load, double v) noexcept {
  const double directed = now.drag_mu * load + now.drag[v > 0.0 ? 0 : 1];
  return site.viscous * v + (v < 0.0 ? -directed : directed);
}

inline double normal_load(const Site& site, const double* wrench, double displacement) noexcept {
  double load = site.load;
  for (int t = site.first_term; t < site.last_term; ++t) {
    const Term& term = terms[t];
    double square = 0.0;
    for (int i = 0; i < term.components; ++i) {
      double part = 0.0;
      for (int k = 0; k < 6; ++k) part += term.map[i][k] * wrench[k];
      if (term.moves)
        for (int k = 0; k < 6; ++k) part += displacement * term.moved[i][k] * wrench[k];
      square += part * part;
    }
    load += std::sqrt(square);
  }
  return load;
}

// The line of a gear around the effort t: F(t) = slope t + offset up to the effort `last`.
struct GearLine { double slope, offset, last; };

// direction: of the joint's motion, 1 or -1. leaving: 1 of what it takes to leave rest, 0 in motion.
inline GearLine gear_line(int d, double direction, double speed, double leaving, double t) noexcept {
  const Drive& gear = drives[d];
  const int side = direction > 0.0 ? 0 : 1;
  const bool up = t >= 0.0;
  const int way = up == (direction > 0.0) ? 0 : 1;
  const double size = std::fabs(t);
  double factor = gear.constant[way];
  if (gear.rise[way] > 0.0)
    factor += gear.rise[way] * power_of(std::fabs(gear.ratio) * speed, gear.exponent[way]);
  int k = gear.first[way];
  const int end = gear.last[way];
  while (k + 1 < end && (size > lines[k + 1].load || (up && size == lines[k + 1].load))) ++k;
  const double rise = factor * lines[k].slope;
  const double offset = factor * lines[k].loss - rise * lines[k].load +
                        (1.0 - leaving) * gear.no_load[side] + leaving * gear.no_load_static[side];
  const double slope = way == 0 ? 1.0 + rise : 1.0 - rise;
  const double last = up ? (k + 1 < end ? lines[k + 1].load : inf) : -lines[k].load;
  return {slope, direction * offset, last};
}

// What must arrive at a gear for the effort t behind it (N m or N).
inline double gear_value(int d, double direction, double speed, double leaving, double t) noexcept {
  const GearLine line = gear_line(d, direction, speed, leaving, t);
  return line.slope * t + line.offset;
}

// Least and greatest value of a gear over the efforts from low to high: at the ends of its lines.
inline void gear_range(int d, double direction, double speed, double leaving, double low, double high,
                       double& least, double& greatest) noexcept {
  GearLine line = gear_line(d, direction, speed, leaving, low);
  least = greatest = line.slope * low + line.offset;
  while (line.last < high) {
    const double value = line.slope * line.last + line.offset;
    least = std::fmin(least, value);
    greatest = std::fmax(greatest, value);
    line = gear_line(d, direction, speed, leaving, line.last);
  }
  const double value = line.slope * high + line.offset;
  least = std::fmin(least, value);
  greatest = std::fmax(greatest, value);
}

inline double motor_drag(int d, double rate) noexcept {  // of the motor, at the joint
  const double size = std::fabs(drives[d].ratio);
  const double drag = size * drives[d].viscous * power_of(size * std::fabs(rate), drives[d].power);
  return rate > 0.0 ? drag : -drag;
}

// The rate of a drive, of the velocities of the freedoms (or its change, of their accelerations).
inline double rate_of(int d, const double* v) noexcept {
  if (!Robot::coupled) return v[d];
  double rate = 0.0;
  for (int i = 0; i < Robot::freedoms; ++i) rate += drive_rate[d][i] * v[i];
  return rate;
}

// What a drive delivers of the efforts that its own joints take.
inline double delivered(int d, const double* effort) noexcept {
  if (!Robot::coupled) return effort[d];
  double total = 0.0;
  for (int i = 0; i < Robot::drives; ++i) total += delivery[d][i] * effort[i];
  return total;
}

}  // namespace detail

// ------------------------------------------------------------------ the compensator

// Friction and gear losses with the load that the joints carry now. It keeps what it was told
// (gravity, payload, wrench) and nothing from one call to the next. Arrays have one number per
// freedom, continuous joints, too (rad, m and per second); `null` stands for zeros where it says so.
// Each call returns false and writes zeros where something is not finite, or an option is none.
class Compensator {
 public:
  Compensator() noexcept {
    for (int k = 0; k < 3; ++k) gravity_[k] = default_gravity[k];
    for (int b = 0; b < Robot::bodies; ++b) {
      masses_[b] = {bodies[b].mass, {bodies[b].com[0], bodies[b].com[1], bodies[b].com[2]}, {}};
      for (int k = 0; k < 6; ++k) masses_[b].inertia[k] = bodies[b].inertia[k];
      detail::clear(outside_[b], 6);
    }
    for (int f = 0; f < frame_slots; ++f) detail::clear(wrench_[f], 6);
  }

  // Gravity in the world's axes (m/s^2). This and the next two not while a loop runs on the object.
  bool set_gravity(const double* gravity) noexcept {
    if (!detail::finite(gravity, 3)) return false;
    for (int k = 0; k < 3; ++k) gravity_[k] = gravity[k];
    return true;
  }

  // Add a body to a frame of Robot::frames. com: in its axes (m); inertia: about the centre of mass,
  // xx xy xz yy yz zz (kg m^2). The payloads that the scene carries by default are there already.
  bool add_payload(int frame, double mass, const double* com, const double* inertia) noexcept {
    if (frame < 0 || frame >= Robot::frame_count || !(mass >= 0.0) || !detail::finite(&mass, 1) ||
        !detail::finite(com, 3) || !detail::finite(inertia, 6))
      return false;
    const Frame& at = frames[frame];
    Mass& body = masses_[at.body];
    const double total = body.mass + mass;
    if (!(total > 0.0)) return true;
    const detail::Vector centre = detail::turned(at.rotation, {com[0], com[1], com[2]});
    const double there[3] = {at.position[0] + centre.x, at.position[1] + centre.y,
                             at.position[2] + centre.z};
    const double share = body.mass * mass / total;
    const double apart[3] = {there[0] - body.com[0], there[1] - body.com[1], there[2] - body.com[2]};
    const double square = apart[0] * apart[0] + apart[1] * apart[1] + apart[2] * apart[2];
    const double* R = at.rotation;
    for (int i = 0, k = 0; i < 3; ++i)
      for (int j = i; j < 3; ++j, ++k) {
        const detail::Vector row = detail::times(inertia, {R[3 * j], R[3 * j + 1], R[3 * j + 2]});
        body.inertia[k] += R[3 * i] * row.x + R[3 * i + 1] * row.y + R[3 * i + 2] * row.z +
                           share * ((i == j ? square : 0.0) - apart[i] * apart[j]);
      }
    for (int k = 0; k < 3; ++k) body.com[k] = (body.mass * body.com[k] + mass * there[k]) / total;
    body.mass = total;
    return true;
  }

  // The wrench on the robot from outside at a frame of Robot::frames, force then moment, in the
  // frame's axes at its origin (N, N m); zeros take it away.
  bool set_wrench(int frame, const double* wrench) noexcept {
    if (frame < 0 || frame >= Robot::frame_count || !detail::finite(wrench, 6)) return false;
    const Frame& at = frames[frame];
    const detail::Vector force = detail::turned(at.rotation, {wrench[0], wrench[1], wrench[2]});
    const detail::Vector moment = detail::sum(
        detail::turned(at.rotation, {wrench[3], wrench[4], wrench[5]}),
        detail::cross({at.position[0], at.position[1], at.position[2]}, force));
    const double here[6] = {force.x, force.y, force.z, moment.x, moment.y, moment.z};
    for (int k = 0; k < 6; ++k) wrench_[frame][k] = here[k];
    detail::clear(outside_[at.body], 6);
    for (int f = 0; f < Robot::frame_count; ++f)
      if (frames[f].body == at.body)
        for (int k = 0; k < 6; ++k) outside_[at.body][k] += wrench_[f][k];
    return true;
  }

  // M a + h less the wrenches from outside, per freedom (N m or N), without friction. v, a: may be null.
  bool rigid_body(const double* q, const double* v, const double* a, double* effort) const noexcept {
    Reactions found;
    const bool good = react(q, v, a, found);
    for (int i = 0; i < Robot::freedoms; ++i) effort[i] = good ? found.effort[i] : 0.0;
    return good;
  }

  // What a motion takes with friction, as pinfric's `Solver.inverse`: intervals where joints stick.
  // v, a: may be null.
  bool inverse(const double* q, const double* v, const double* a, Instant& out) const noexcept {
    Reactions found;
    return bound(q, v, a, found, out);
  }

  // The friction that the drives must overcome, at the joints (N m or N): to be added to a torque.
  //   q, v, a: state whose load counts; v, a null: the load of gravity.
  //   v_ref: velocity whose friction is compensated: desired or measured.
  //   error: desired less actual position, v_now: measured velocity; null: no hold, no power watch.
  bool friction(const double* q, const double* v, const double* a, const double* v_ref,
                const double* error, const double* v_now, const Options& options,
                double* out) const noexcept {
    Reactions found;
    if (!react(q, v, a, found)) {
      detail::clear(out, Robot::drives);
      return false;
    }
    double load[sites_size] = {};
    write_loads(q, found, load);
    return compensate(found.effort, load, v_ref, error, v_now, options, out);
  }

  // Feed-forward of a desired motion at the motors' shafts (N m), with the interval that it lies in:
  // rigid body, rotors and `friction` at v. v, a, error, v_now: may be null.
  bool motor_torque(const double* q, const double* v, const double* a, const double* error,
                    const double* v_now, const Options& options, double* out,
                    Instant& instant) const noexcept {
    Reactions found;
    if (!bound(q, v, a, found, instant)) {
      detail::clear(out, Robot::drives);
      return false;
    }
    if (!compensate(found.effort, instant.normal_load, v ? v : zeros(), error, v_now, options,
                    out)) {
      instant = Instant();
      return false;
    }
    for (int d = 0; d < Robot::drives; ++d) {
      const Drive& drive = drives[d];
      out[d] = (instant.effort_frictionless[d] + out[d]) / drive.ratio +
               drive.ratio * drive.rotor_inertia * (a ? detail::rate_of(d, a) : 0.0);
    }
    return true;
  }

 private:
  static constexpr int sites_size = Robot::sites > 0 ? Robot::sites : 1;
  static constexpr int frame_slots = Robot::frame_count > 0 ? Robot::frame_count : 1;
  struct Mass { double mass, com[3], inertia[6]; };
  struct Reactions { double wrench[Robot::bodies][6], effort[Robot::freedoms]; };

  double gravity_[3];
  Mass masses_[Robot::bodies];
  double outside_[Robot::bodies][6];  // wrench from outside on each body, at its joint's origin
  double wrench_[frame_slots][6];     // the same of each frame

  static const double* zeros() noexcept {
    static constexpr double none[Robot::freedoms] = {};
    return none;
  }

  // Newton and Euler: motions from the ground outwards, wrenches inwards.
  bool react(const double* q, const double* v, const double* a, Reactions& out) const noexcept {
    using detail::Vector;
    struct Motion { Vector w, dw, a; };  // velocity of turning, its change, acceleration - gravity
    if (!v) v = zeros();
    if (!a) a = zeros();
    if (!detail::finite(q, Robot::freedoms) || !detail::finite(v, Robot::freedoms) ||
        !detail::finite(a, Robot::freedoms))
      return false;
    double rotation[Robot::bodies][9];
    Vector position[Robot::bodies];
    Motion motion[Robot::bodies];
    const Motion ground = {{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0},
                           {-gravity_[0], -gravity_[1], -gravity_[2]}};
    for (int b = 0; b < Robot::bodies; ++b) {
      const Body& body = bodies[b];
      const Motion& base = body.parent < 0 ? ground : motion[body.parent];
      const double at = body.ratio * q[body.freedom] + body.shift;
      const double rate = body.ratio * v[body.freedom], change = body.ratio * a[body.freedom];
      const double* P = body.rotation;
      double* R = rotation[b];
      Vector& p = position[b];
      p = {body.position[0], body.position[1], body.position[2]};
      if (body.turns) {
        const double s = std::sin(at), c = std::cos(at);
        for (int i = 0; i < 9; i += 3) {
          R[i] = c * P[i] + s * P[i + 1];
          R[i + 1] = c * P[i + 1] - s * P[i];
          R[i + 2] = P[i + 2];
        }
      } else {
        for (int i = 0; i < 9; ++i) R[i] = P[i];
        p = detail::sum(p, {at * P[2], at * P[5], at * P[8]});
      }
      const Vector carried = detail::sum(
          base.a, detail::sum(detail::cross(base.dw, p), detail::cross(base.w, detail::cross(base.w, p))));
      Motion& now = motion[b];
      now.w = detail::turned_back(R, base.w);
      now.dw = detail::turned_back(R, base.dw);
      now.a = detail::turned_back(R, carried);
      if (body.turns) {
        now.dw = {now.dw.x + now.w.y * rate, now.dw.y - now.w.x * rate, now.dw.z + change};
        now.w.z += rate;
      } else {
        now.a = {now.a.x + 2.0 * now.w.y * rate, now.a.y - 2.0 * now.w.x * rate, now.a.z + change};
      }
      const Mass& mass = masses_[b];
      const Vector com = {mass.com[0], mass.com[1], mass.com[2]};
      const Vector pull = detail::sum(now.a, detail::sum(detail::cross(now.dw, com),
                                                         detail::cross(now.w, detail::cross(now.w, com))));
      const Vector force = {mass.mass * pull.x, mass.mass * pull.y, mass.mass * pull.z};
      const Vector spin = detail::sum(detail::times(mass.inertia, now.dw),
                                      detail::cross(now.w, detail::times(mass.inertia, now.w)));
      const Vector moment = detail::sum(spin, detail::cross(com, force));
      const double* f = outside_[b];
      double* w = out.wrench[b];
      w[0] = force.x - f[0];
      w[1] = force.y - f[1];
      w[2] = force.z - f[2];
      w[3] = moment.x - f[3];
      w[4] = moment.y - f[4];
      w[5] = moment.z - f[5];
    }
    for (int i = 0; i < Robot::freedoms; ++i) out.effort[i] = armature[i] * a[i];
    for (int b = Robot::bodies - 1; b >= 0; --b) {
      const Body& body = bodies[b];
      const double* w = out.wrench[b];
      out.effort[body.freedom] += body.ratio * w[body.turns ? 5 : 2];
      if (body.parent < 0) continue;
      const Vector force = detail::turned(rotation[b], {w[0], w[1], w[2]});
      const Vector moment = detail::sum(detail::turned(rotation[b], {w[3], w[4], w[5]}),
                                        detail::cross(position[b], force));
      double* on = out.wrench[body.parent];
      on[0] += force.x;
      on[1] += force.y;
      on[2] += force.z;
      on[3] += moment.x;
      on[4] += moment.y;
      on[5] += moment.z;
    }
    return detail::finite(out.effort, Robot::freedoms);
  }

  static void write_loads(const double* q, const Reactions& found, double* load) noexcept {
    for (int s = 0; s < Robot::sites; ++s) {
      const Body& body = bodies[sites[s].body];
      const double displacement = body.ratio * q[body.freedom] + body.shift;
      load[s] = detail::normal_load(sites[s], found.wrench[sites[s].body], displacement);
    }
  }

  bool bound(const double* q, const double* v, const double* a, Reactions& found,
             Instant& out) const noexcept {
    out = Instant();
    if (!react(q, v, a, found)) return false;
    if (!v) v = zeros();
    if (!a) a = zeros();
    write_loads(q, found, out.normal_load);
    double lower[Robot::freedoms], upper[Robot::freedoms];
    for (int i = 0; i < Robot::freedoms; ++i) lower[i] = upper[i] = found.effort[i];
    for (int s = 0; s < Robot::sites; ++s) {
      const Site& site = sites[s];
      const double* w = found.wrench[site.body];
      const double* turn = bodies[site.body].turn;
      const detail::Vector force = detail::turned_back(turn, {w[0], w[1], w[2]});
      const detail::Vector moment = detail::turned_back(turn, {w[3], w[4], w[5]});
      const double here[6] = {force.x, force.y, force.z, moment.x, moment.y, moment.z};
      for (int k = 0; k < 6; ++k) out.wrench[s][k] = here[k];
      bound_friction(s, site.ratio * v[site.freedom], out);
      const double r = site.ratio;
      lower[site.freedom] -= r * (r >= 0.0 ? out.friction_upper[s] : out.friction_lower[s]);
      upper[site.freedom] -= r * (r >= 0.0 ? out.friction_lower[s] : out.friction_upper[s]);
    }
    bool good = true;
    for (int d = 0; d < Robot::drives; ++d) good &= bound_drive(d, found.effort, lower, upper, v, a, out);
    if (!good) out = Instant();
    return good;
  }

  static void bound_friction(int s, double v, Instant& out) noexcept {
    const Site& site = sites[s];
    const double c = out.normal_load[s], speed = std::fabs(v);
    const detail::Moving now = detail::friction_at(site, speed);
    const double drag = detail::drag_of(site, now, c, v);
    out.sticking[s] = speed <= site.stick_velocity;
    if (out.sticking[s]) {
      const double forward = site.mu_static * c + site.coulomb_static[0];
      const double backward = site.mu_static * c + site.coulomb_static[1];
      const bool dry = site.mu_static > 0.0 || site.coulomb_static[0] > 0.0 || site.coulomb_static[1] > 0.0;
      out.friction_lower[s] = -forward - (dry ? std::fmax(drag, 0.0) : drag);
      out.friction_upper[s] = backward - (dry ? std::fmin(drag, 0.0) : drag);
    } else {
      const double phi = v > 0.0 ? -(now.mu * c + now.coulomb[0]) - drag : now.mu * c + now.coulomb[1] - drag;
      out.friction_lower[s] = out.friction_upper[s] = phi;
    }
  }

  // Efforts and motor torques of one drive, from the ends of the efforts of all freedoms.
  static bool bound_drive(int d, const double* effort, const double* lower, const double* upper,
                          const double* v, const double* a, Instant& out) noexcept {
    double low = lower[d], high = upper[d];
    if (Robot::coupled) {
      low = high = 0.0;
      for (int i = 0; i < Robot::drives; ++i) {
        low += delivery[d][i] * (delivery[d][i] > 0.0 ? lower[i] : upper[i]);
        high += delivery[d][i] * (delivery[d][i] > 0.0 ? upper[i] : lower[i]);
      }
    }
    const Drive& drive = drives[d];
    const double rate = detail::rate_of(d, v), speed = std::fabs(rate), r = drive.ratio;
    double least, greatest, unused;
    if (speed <= drive.stick_velocity) {
      detail::gear_range(d, -1.0, speed, 1.0, low, high, least, unused);
      detail::gear_range(d, 1.0, speed, 1.0, low, high, unused, greatest);
    } else {
      detail::gear_range(d, rate > 0.0 ? 1.0 : -1.0, speed, 0.0, low, high, least, greatest);
    }
    const double motor = r * drive.rotor_inertia * detail::rate_of(d, a) + detail::motor_drag(d, rate) / r;
    out.effort_frictionless[d] = detail::delivered(d, effort);
    out.effort_lower[d] = low;
    out.effort_upper[d] = high;
    out.motor_torque_lower[d] = std::fmin(least / r, greatest / r) + motor;
    out.motor_torque_upper[d] = std::fmax(least / r, greatest / r) + motor;
    const double all[3] = {low + high, out.motor_torque_lower[d], out.motor_torque_upper[d]};
    return detail::finite(all, 3);
  }

  // Directions s in [-1, 1] and shares of break-away in [0, 1], of joints and of drives.
  struct Directions {
    double joint[Robot::freedoms], joint_leaving[Robot::freedoms];
    double drive[Robot::drives], drive_leaving[Robot::drives];
  };

  // The direction that is compensated, and how much of break-away: see `hold_error`.
  static void direct(double v_ref, double band, double error, double hold, double v_now, bool holds,
                     double& direction, double& leaving) noexcept {
    leaving = 0.0;
    if (!(band > 0.0)) {
      direction = detail::sign(v_ref);
      return;
    }
    const double x = v_ref / band;
    if (!holds || !(hold > 0.0)) {
      direction = detail::smooth_sign(x);
      return;
    }
    direction = detail::smooth_sign(x + detail::bell(x) * detail::smooth_sign(error / hold));
    leaving = detail::bell(v_now / band) * std::fabs(direction);  // a joint that slips is not driven
  }

  // D of every drive, and what of friction vanishes at rest, at the velocities v (N m or N):
  //   D = (1+s)/2 F_+(P t(+)) + (1-s)/2 F_-(P t(-)) - P tau - P drag
  static void friction_of(const double* effort, const double* load, const double* v,
                          const Directions& to, double* dry, double* drag) noexcept {
    double ahead[Robot::freedoms] = {}, back[Robot::freedoms] = {}, slow[Robot::freedoms] = {};
    for (int s = 0; s < Robot::sites; ++s) {
      const Site& site = sites[s];
      const int i = site.freedom;
      const double rate = site.ratio * v[i], size = std::fabs(site.ratio);
      const double leaving = to.joint_leaving[i], c = load[s];
      const detail::Moving now = detail::friction_at(site, std::fabs(rate));
      const double mu = (1.0 - leaving) * now.mu + leaving * site.mu_static;
      const int forward = site.ratio >= 0.0 ? 0 : 1;
      ahead[i] += size * (mu * c + (1.0 - leaving) * now.coulomb[forward] +
                          leaving * site.coulomb_static[forward]);
      back[i] += size * (mu * c + (1.0 - leaving) * now.coulomb[1 - forward] +
                         leaving * site.coulomb_static[1 - forward]);
      slow[i] += site.ratio * detail::drag_of(site, now, c, rate);
    }
    double plus[Robot::freedoms], minus[Robot::freedoms], rest[Robot::freedoms];
    for (int i = 0; i < Robot::freedoms; ++i) {
      const double s = to.joint[i];
      rest[i] = effort[i] + slow[i];
      plus[i] = rest[i] + ahead[i];
      minus[i] = rest[i] - back[i];
      if (Robot::coupled && together[i])  // its gears' directions are not the joint's
        plus[i] = minus[i] = rest[i] + 0.5 * (1.0 + s) * ahead[i] - 0.5 * (1.0 - s) * back[i];
    }
    for (int d = 0; d < Robot::drives; ++d) {
      const double s = to.drive[d], leaving = to.drive_leaving[d];
      const double rate = detail::rate_of(d, v), speed = std::fabs(rate);
      double sum = 0.0;
      if (s > -1.0)
        sum += 0.5 * (1.0 + s) *
               detail::gear_value(d, 1.0, speed, leaving, detail::delivered(d, plus));
      if (s < 1.0)
        sum += 0.5 * (1.0 - s) *
               detail::gear_value(d, -1.0, speed, leaving, detail::delivered(d, minus));
      dry[d] = sum - detail::delivered(d, rest);
      drag[d] = detail::delivered(d, slow) + detail::motor_drag(d, rate);
    }
  }

  // Options are numbers that are not negative; limits and powers may be infinite.
  static bool valid(const Options& options) noexcept {
    for (int d = 0; d < Robot::drives; ++d) {
      const double given[4] = {options.scale[d], options.viscous_scale[d],
                               options.switch_velocity[d], options.hold_error[d]};
      if (!detail::finite(given, 4) || !(options.limit[d] >= 0.0) || !(options.power[d] >= 0.0))
        return false;
      for (const double x : given)
        if (x < 0.0) return false;
    }
    return true;
  }

  static bool compensate(const double* effort, const double* load, const double* v_ref,
                         const double* error, const double* v_now, const Options& options,
                         double* out) noexcept {
    detail::clear(out, Robot::drives);
    if (!detail::finite(v_ref, Robot::freedoms) ||
        (error && !detail::finite(error, Robot::freedoms)) ||
        (v_now && !detail::finite(v_now, Robot::freedoms)) || !valid(options))
      return false;
    const bool holds = error && v_now;
    const double* e = error ? error : zeros();
    const double* now = v_now ? v_now : zeros();
    Directions to;
    bool watched = false;
    for (int d = 0; d < Robot::drives; ++d) {
      const double band = options.switch_velocity[d], hold = options.hold_error[d];
      direct(v_ref[d], band, e[d], hold, now[d], holds, to.joint[d], to.joint_leaving[d]);
      to.drive[d] = to.joint[d];
      to.drive_leaving[d] = to.joint_leaving[d];
      if (Robot::coupled)
        direct(detail::rate_of(d, v_ref), band, detail::rate_of(d, e), hold, detail::rate_of(d, now),
               holds, to.drive[d], to.drive_leaving[d]);
      watched |= v_now && options.power[d] < inf;
    }
    double dry[Robot::drives], drag[Robot::drives];
    friction_of(effort, load, v_ref, to, dry, drag);
    double result[Robot::drives];
    for (int d = 0; d < Robot::drives; ++d)
      result[d] = options.scale[d] * dry[d] + options.viscous_scale[d] * drag[d];
    if (!detail::finite(result, Robot::drives)) return false;  // before a limit hides it
    for (int d = 0; d < Robot::drives; ++d)
      result[d] = std::fmax(-options.limit[d], std::fmin(options.limit[d], result[d]));
    if (watched) watch_power(effort, load, v_now, options, result);
    if (!detail::finite(result, Robot::drives)) return false;
    for (int d = 0; d < Robot::drives; ++d) out[d] = result[d];
    return true;
  }

  // Let the compensation give no more power than friction takes at v_now, and options.power.
  static void watch_power(const double* effort, const double* load, const double* v_now,
                          const Options& options, double* out) noexcept {
    Directions to;
    for (int d = 0; d < Robot::drives; ++d) {
      to.joint[d] = detail::sign(v_now[d]);
      to.drive[d] = detail::sign(detail::rate_of(d, v_now));
      to.joint_leaving[d] = to.drive_leaving[d] = 0.0;
    }
    double dry[Robot::drives], drag[Robot::drives];
    friction_of(effort, load, v_now, to, dry, drag);
    for (int d = 0; d < Robot::drives; ++d) {
      const double rate = detail::rate_of(d, v_now), lost = dry[d] + drag[d];
      if (out[d] * rate > lost * rate + options.power[d]) out[d] = lost + options.power[d] / rate;
    }
  }
};

}  // namespace pinfric_scene

#endif
