// @@TITLE
#pragma once
#ifdef PINFRIC_SCENE_@@HASH
#pragma message("pinfric: another header of the robot of pinfric_scene, with the same constants: once is enough")
#else
#define PINFRIC_SCENE_@@HASH
#ifdef PINFRIC_SCENE_HPP
#pragma message("pinfric: two robots share the namespace pinfric_scene: name this one in full, pinfric_scene::constants_@@HASH, or export it with --namespace")
#endif
#define PINFRIC_SCENE_HPP

#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__)
#error "pinfric: -ffast-math takes away the checks for NaN; compile this header without it"
#endif
#ifdef _M_FP_FAST
#error "pinfric: /fp:fast takes away the checks for NaN; compile this header without it"
#endif

#include <cmath>
#include <limits>

// Other constants have another inner namespace, so that no linker takes one robot for another.
namespace pinfric_scene {
inline namespace constants_@@HASH {

#if defined(__GNUC__)
__attribute__((used))
#endif
inline constexpr char made_of[] = "@@MADE_OF";  // in the program's file: `strings` shows it

inline constexpr double inf = std::numeric_limits<double>::infinity();
inline constexpr double pi = 3.14159265358979323846;

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

inline constexpr double largest = 1e12;  // of masses, lengths, forces

// @@CONSTANTS

// ------------------------------------------------------------------ what a controller sees

// A view of numbers that stand elsewhere: of an array of that length, or of what has data() and
// size(), as std::array, std::vector and Eigen's vectors have. A call with another length, or with
// none where numbers are needed, returns false.
template <class Number, unsigned count>
class View {
 public:
  View() noexcept = default;  // none
  View(Number (&array)[count]) noexcept : first_(array) {}
  template <class Array, class = decltype(static_cast<Array*>(nullptr)->data())>
  View(Array& array) noexcept
      : first_(array.data()),
        fits_(static_cast<unsigned long long>(array.size()) == count) {}
  // Of a pointer to the first of as many numbers as there must be: nothing checks that.
  static View at(Number* first) noexcept {
    View view;
    view.first_ = first;
    return view;
  }
  bool fits() const noexcept { return fits_; }
  Number* first() const noexcept { return first_; }  // null: none

 private:
  Number* first_ = nullptr;
  bool fits_ = true;
};
using Freedoms = View<const double, Robot::freedoms>;
using Drives = View<double, Robot::drives>;

// A state of the robot: one number per freedom, in the order of Robot::freedom_names.
struct State {
  Freedoms q;             // positions (rad or m), continuous joints, too
  Freedoms v, a;          // velocities, accelerations whose load counts; none: the load of gravity
  Freedoms v_ref;         // desired velocity whose friction is compensated; none: v
  Freedoms q_ref;         // desired positions, where friction builds up over a way; none: q
  Freedoms error, v_now;  // desired less actual position; measured velocity
};

// What a call says of itself.
struct [[nodiscard]] Outcome {
  bool good = false;                     // else it wrote zeros
  bool limited[Robot::drives] = {};      // whether a limit cut what the drive gets
  explicit operator bool() const noexcept { return good; }
};

// How the compensation behaves; one number per drive. An option that could do nothing is refused:
// hold_error without State's error and v_now or without hold_velocity, power without v_now;
// hold_error at a measured velocity, which it would drive, and where friction builds up over a way.
struct Options {
  double scale[Robot::drives];            // of dry friction and gear losses, at a desired velocity
  double viscous_scale[Robot::drives];    // of friction that vanishes at rest, there
  double measured_scale[Robot::drives];   // of both at a measured velocity: at most `stable_scale`
  double measured_way[Robot::drives];     // over which it changes direction there: at least that over
                                          // which the joint yields before it slips (rad or m)
  double switch_velocity[Robot::drives];  // band of the desired velocity in which the direction changes
                                          // (rad/s or m/s), where the robot has no presliding_way
  double hold_error[Robot::drives];       // position error that asks for all of break-away; 0: off
  double hold_velocity[Robot::drives];    // band, desired and measured, in which it acts (rad/s or m/s):
                                          // wider than the noise of v_now
  double limit[Robot::drives];            // of the compensation (N m or N)
  double joint_effort_limit[Robot::drives];  // of joint_effort, rigid body and rotors with it (N m or N)
  double power[Robot::drives];            // it may inject beyond friction (W); inf: not watched

  Options() noexcept {
    for (int d = 0; d < Robot::drives; ++d) {
      scale[d] = viscous_scale[d] = 1.0;
      measured_scale[d] = default_measured_scale[d];
      measured_way[d] = default_measured_way[d];
      switch_velocity[d] = 0.002;
      hold_error[d] = 0.0;
      hold_velocity[d] = 0.02;
      limit[d] = default_limit[d];
      joint_effort_limit[d] = default_joint_effort_limit[d];
      power[d] = inf;
    }
  }
};

// All that follows from one state (N m or N), by the names of pinfric's `Solver.inverse`.
struct InverseInstant {
  double effort_frictionless[Robot::drives];
  double effort_lower[Robot::drives], effort_upper[Robot::drives];  // at the joint, after the gear
  // All that a torque command at the joint contains, as that of ros2_control's effort interface:
  // rigid body, rotors, friction and gear losses; ratio x motor_torque.
  double joint_effort_lower[Robot::drives], joint_effort_upper[Robot::drives];
  double motor_torque_lower[Robot::drives], motor_torque_upper[Robot::drives];  // N m at the shaft
  double wrench[Robot::sites > 0 ? Robot::sites : 1][6];  // parent on child, in the child's frame
  double normal_load[Robot::sites > 0 ? Robot::sites : 1];
  double friction_lower[Robot::sites > 0 ? Robot::sites : 1];  // of the parent on the child
  double friction_upper[Robot::sites > 0 ? Robot::sites : 1];
  bool sticking[Robot::sites > 0 ? Robot::sites : 1];
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
// Whether all are numbers of at most that size.
inline bool within(const double* values, int count, double size) noexcept {
  bool good = values != nullptr;
  for (int i = 0; good && i < count; ++i) good = std::fabs(values[i]) <= size;
  return good;
}
inline bool finite(const double* values, int count) noexcept {
  return within(values, count, std::numeric_limits<double>::max());
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
// (gravity, payload, wrench) and, from call to call, one number a drive: how far friction has built
// up since the joint reversed, by the measured positions of friction_measured, and by the desired ones
// of the other calls where the robot's friction builds up over a way. Each call returns false and
// writes zeros where a number is not finite or beyond what a robot has, or an option does nothing. Each
// control loop needs an object of its own.
// A result may be written where a number of the state stands.
class Compensator {
 public:
  Compensator() noexcept {
    for (int k = 0; k < 3; ++k) gravity_[k] = default_gravity[k];
    for (int b = 0; b < Robot::bodies; ++b) {
      load_body(b);
      detail::clear(outside_[b], 6);
    }
    for (int f = 0; f < frame_slots; ++f) detail::clear(wrench_[f], 6);
    reset();
  }

  // Forget in which direction the joints moved, as after a stop of the controller.
  void reset() noexcept { measured_ = desired_ = Travelled(); }

  // Gravity in the world's axes (m/s^2). This and the setters below not while a loop runs on the object.
  [[nodiscard]] bool set_gravity(View<const double, 3> gravity) noexcept {
    if (!gravity.fits() || !detail::within(gravity.first(), 3, largest)) return false;
    for (int k = 0; k < 3; ++k) gravity_[k] = gravity.first()[k];
    return true;
  }

  // Add a body to a frame of Robot::frames. com: in its axes (m); inertia: about the centre of mass,
  // xx xy xz yy yz zz (kg m^2). The payloads that the scene carries by default are there already.
  // False, and nothing changed, where no body has such a mass and inertia, or its centre of mass is
  // farther from the frame than `farthest`, or it is heavier than `heaviest`: millimetres in place of
  // metres, grams in place of kilograms.
  [[nodiscard]] bool add_payload(int frame, double mass, View<const double, 3> com,
                                 View<const double, 6> inertia) noexcept {
    return carry(frame, mass, com, inertia, true);
  }

  // The same in place of what was added to that frame before.
  [[nodiscard]] bool set_payload(int frame, double mass, View<const double, 3> com,
                                 View<const double, 6> inertia) noexcept {
    return carry(frame, mass, com, inertia, false);
  }

  // Put down all that was added: what the scene carries by default stays.
  void clear_payloads() noexcept {
    for (Mass& payload : carried_) payload = Mass();
    for (int b = 0; b < Robot::bodies; ++b) load_body(b);
  }

  // The wrench on the robot from outside at a frame of Robot::frames, force then moment, in the
  // frame's axes at its origin (N, N m); zeros take it away.
  [[nodiscard]] bool set_wrench(int frame, View<const double, 6> given) noexcept {
    const double* wrench = given.first();
    if (frame < 0 || frame >= Robot::frame_count || !given.fits() ||
        !detail::within(wrench, 6, largest))
      return false;
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

  // M a + h less the wrenches from outside, per freedom (N m or N), without friction and rotors.
  [[nodiscard]] bool rigid_body(const State& state, View<double, Robot::freedoms> out) const noexcept {
    Reactions found;
    const bool good = react(state, found);
    for (int i = 0; out.fits() && out.first() && i < Robot::freedoms; ++i)
      out.first()[i] = good ? found.effort[i] : 0.0;
    return good && out.fits() && out.first();
  }

  // What a motion takes with friction, as pinfric's `Solver.inverse`: intervals where joints stick.
  [[nodiscard]] bool inverse(const State& state, InverseInstant& out) const noexcept {
    Reactions found;
    return bound(state, found, out);
  }

  // The friction and gear losses that the drives must overcome at the desired velocity v_ref, at the
  // joints: to be added to the torque of a controller that has rigid body and rotors (ratio^2
  // rotor_inertia a) of its own.
  Outcome friction(const State& state, const Options& options, Drives out) const noexcept {
    return compensation(false, state, options, out);
  }

  // The same at the measured velocity v_now, as for hand guiding, by measured_scale. Its direction
  // follows the measured q of each cycle over measured_way. A feedback loop that is passive while the
  // model's friction is at most 1 / measured_scale times the joint's, and the joint slips after at most
  // measured_way: one that yields farther may swing without end after a push. A v_ref is refused.
  Outcome friction_measured(const State& state, const Options& options, Drives out) const noexcept {
    return compensation(true, state, options, out);
  }

  // Feed-forward of a motion at the joints, all that a torque command there contains: rigid body,
  // rotors and `friction` at v_ref. Outside the band of switch_velocity, at scale 1 and v_ref = v, it
  // lies in the interval of `inverse`; inside the band it need not. joint_effort_limit cuts all of it.
  Outcome joint_effort(const State& state, const Options& options, Drives out) const noexcept {
    Reactions found;
    double load[sites_size] = {}, whole[Robot::drives];
    const bool good = react(state, found);
    if (good) write_loads(state.q.first(), found, load);
    const Outcome outcome = good ? feed_forward(found, load, state, options, whole) : Outcome();
    return written(outcome, whole, out);
  }

  // The same at the motors' shafts (N m), with the interval of the state.
  Outcome motor_torque(const State& state, const Options& options, Drives out,
                       InverseInstant& instant) const noexcept {
    Reactions found;
    double whole[Robot::drives];
    Outcome outcome;
    if (bound(state, found, instant))
      outcome = feed_forward(found, instant.normal_load, state, options, whole);
    if (outcome)
      for (int d = 0; d < Robot::drives; ++d) whole[d] /= drives[d].ratio;
    outcome = written(outcome, whole, out);
    if (!outcome) instant = InverseInstant();
    return outcome;
  }

 private:
  static constexpr int sites_size = Robot::sites > 0 ? Robot::sites : 1;
  static constexpr int frame_slots = Robot::frame_count > 0 ? Robot::frame_count : 1;
  struct Mass { double mass = 0.0, com[3] = {}, inertia[6] = {}; };  // in the body's axes
  struct Reactions { double wrench[Robot::bodies][6], effort[Robot::freedoms]; };
  struct Travelled {  // z in [-1, 1] of drives and of the joints on which they act, and where they were
    bool begun = false;
    double before[Robot::freedoms] = {}, drive[Robot::drives] = {}, joint[Robot::drives] = {};
  };

  double gravity_[3];
  Mass masses_[Robot::bodies];
  Mass carried_[frame_slots];         // what was added to each frame
  double outside_[Robot::bodies][6];  // wrench from outside on each body, at its joint's origin
  double wrench_[frame_slots][6];     // the same of each frame
  mutable Travelled measured_, desired_;  // one object for each loop: calls move them on

  static const double* zeros() noexcept {
    static constexpr double none[Robot::freedoms] = {};
    return none;
  }

  static const double* or_zeros(const Freedoms& view) noexcept {
    return view.first() ? view.first() : zeros();
  }

  // Whether velocities are such as a joint can have.
  static bool slow_enough(const double* v) noexcept {
    bool good = true;
    for (int i = 0; good && i < Robot::freedoms; ++i) good = std::fabs(v[i]) <= greatest_velocity[i];
    return good;
  }

  Outcome compensation(bool measured, const State& state, const Options& options,
                       Drives out) const noexcept {
    Reactions found;
    double load[sites_size] = {}, extra[Robot::drives];
    const bool good = react(state, found);
    if (good) write_loads(state.q.first(), found, load);
    const Outcome outcome =
        good ? compensate(found.effort, load, state, options, measured, extra) : Outcome();
    return written(outcome, extra, out);
  }

  // Write what a call found, or zeros.
  static Outcome written(Outcome outcome, const double* found, Drives out) noexcept {
    if (!out.fits() || !out.first()) return Outcome();
    for (int d = 0; d < Robot::drives; ++d) out.first()[d] = outcome ? found[d] : 0.0;
    return outcome;
  }

  // Whether a body has that mass and inertia: no principal moment exceeds the sum of the others,
  // so tr(J)/2 - J has no negative eigenvalue, but for the rounding of a file. tr(J)/2 is at least the
  // largest moment, so it bounds the radius of gyration.
  static bool possible(double mass, const double* com, const double* J) noexcept {
    if (!(mass >= 0.0) || !(mass <= heaviest) || !detail::within(com, 3, farthest) ||
        !detail::within(J, 6, largest))
      return false;
    if (com[0] * com[0] + com[1] * com[1] + com[2] * com[2] > farthest * farthest) return false;
    const double half = 0.5 * (J[0] + J[3] + J[5]), slack = 5e-4 * std::fabs(half) + 5e-10;
    if (half > mass * farthest * farthest + slack) return false;
    if (mass == 0.0 && (std::fabs(J[0]) > 1e-9 || std::fabs(J[3]) > 1e-9 || std::fabs(J[5]) > 1e-9))
      return false;
    const double x = half - J[0] + slack, y = half - J[3] + slack, z = half - J[5] + slack;
    if (!(x > 0.0)) return false;  // Cholesky's pivots
    const double second = y - J[1] * J[1] / x, across = -J[4] - J[1] * J[2] / x;
    return second > 0.0 && z - J[2] * J[2] / x - across * across / second > 0.0;
  }

  // Two bodies that are one.
  static Mass together_with(const Mass& one, const Mass& other) noexcept {
    Mass both = one;
    both.mass = one.mass + other.mass;
    if (!(both.mass > 0.0)) return both;
    const double share = one.mass * other.mass / both.mass;
    double apart[3], square = 0.0;
    for (int k = 0; k < 3; ++k) {
      apart[k] = other.com[k] - one.com[k];
      square += apart[k] * apart[k];
      both.com[k] = (one.mass * one.com[k] + other.mass * other.com[k]) / both.mass;
    }
    for (int i = 0, k = 0; i < 3; ++i)
      for (int j = i; j < 3; ++j, ++k)
        both.inertia[k] += other.inertia[k] + share * ((i == j ? square : 0.0) - apart[i] * apart[j]);
    return both;
  }

  bool carry(int frame, double mass, View<const double, 3> centred, View<const double, 6> moments,
             bool more) noexcept {
    const double *com = centred.first(), *inertia = moments.first();
    if (frame < 0 || frame >= Robot::frame_count || !centred.fits() || !moments.fits() ||
        !possible(mass, com, inertia))
      return false;
    const Frame& at = frames[frame];
    const double* R = at.rotation;
    const detail::Vector centre = detail::turned(R, {com[0], com[1], com[2]});
    Mass payload;
    payload.mass = mass;
    payload.com[0] = at.position[0] + centre.x;
    payload.com[1] = at.position[1] + centre.y;
    payload.com[2] = at.position[2] + centre.z;
    for (int i = 0, k = 0; i < 3; ++i)
      for (int j = i; j < 3; ++j, ++k) {
        const detail::Vector row = detail::times(inertia, {R[3 * j], R[3 * j + 1], R[3 * j + 2]});
        payload.inertia[k] = R[3 * i] * row.x + R[3 * i + 1] * row.y + R[3 * i + 2] * row.z;
      }
    carried_[frame] = more ? together_with(carried_[frame], payload) : payload;
    load_body(at.body);
    return true;
  }

  // The mass of a body with what it carries.
  void load_body(int b) noexcept {
    Mass own;
    own.mass = bodies[b].mass;
    for (int k = 0; k < 3; ++k) own.com[k] = bodies[b].com[k];
    for (int k = 0; k < 6; ++k) own.inertia[k] = bodies[b].inertia[k];
    for (int f = 0; f < Robot::frame_count; ++f)
      if (frames[f].body == b) own = together_with(own, carried_[f]);
    masses_[b] = own;
  }

  // Newton and Euler: motions from the ground outwards, wrenches inwards. False for a state that no
  // robot has: not finite, far beyond the joint's limits (degrees in place of radians).
  bool react(const State& state, Reactions& out) const noexcept {
    using detail::Vector;
    struct Motion { Vector w, dw, a; };  // velocity of turning, its change, acceleration - gravity
    const double *q = state.q.first(), *v = or_zeros(state.v), *a = or_zeros(state.a);
    if (!q || !state.q.fits() || !state.v.fits() || !state.a.fits() || !slow_enough(v) ||
        !detail::within(a, Robot::freedoms, greatest_acceleration))
      return false;
    for (int i = 0; i < Robot::freedoms; ++i)
      if (!(q[i] >= least_position[i] && q[i] <= greatest_position[i])) return false;
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

  bool bound(const State& state, Reactions& found, InverseInstant& out) const noexcept {
    out = InverseInstant();
    if (!react(state, found)) return false;
    const double *v = or_zeros(state.v), *a = or_zeros(state.a);
    write_loads(state.q.first(), found, out.normal_load);
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
    if (!good) out = InverseInstant();
    return good;
  }

  static void bound_friction(int s, double v, InverseInstant& out) noexcept {
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
                          const double* v, const double* a, InverseInstant& out) noexcept {
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
    out.joint_effort_lower[d] = least + r * motor;
    out.joint_effort_upper[d] = greatest + r * motor;
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
  static void direct(double v_ref, double band, double error, double hold, double v_now, double slow,
                     double& direction, double& leaving) noexcept {
    leaving = 0.0;
    if (!(hold > 0.0)) {
      direction = band > 0.0 ? detail::smooth_sign(v_ref / band) : detail::sign(v_ref);
      return;
    }
    const double x = v_ref / slow;
    direction = detail::smooth_sign(x + detail::bell(x) * detail::smooth_sign(error / hold));
    leaving = detail::bell(v_now / slow) * std::fabs(direction);  // a joint that slips is not driven
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
      const double given[5] = {options.scale[d], options.viscous_scale[d],
                               options.switch_velocity[d], options.hold_error[d],
                               options.hold_velocity[d]};
      if (!detail::finite(given, 5) || !(options.limit[d] >= 0.0) || !(options.power[d] >= 0.0) ||
          !(options.joint_effort_limit[d] >= 0.0) || !(options.measured_scale[d] >= 0.0) ||
          !(options.measured_scale[d] <= stable_scale[d]) || !(options.measured_way[d] > 0.0) ||
          !(options.measured_way[d] >= presliding_way[d]) || !(options.measured_way[d] <= largest))
        return false;
      for (const double x : given)
        if (x < 0.0) return false;
    }
    return true;
  }

  // Rigid body, friction and rotors, at the joints.
  Outcome feed_forward(const Reactions& found, const double* load, const State& state,
                       const Options& options, double* out) const noexcept {
    Outcome outcome = compensate(found.effort, load, state, options, false, out);
    const double* a = or_zeros(state.a);
    for (int d = 0; outcome && d < Robot::drives; ++d) {
      const Drive& drive = drives[d];
      out[d] += detail::delivered(d, found.effort) +
                drive.ratio * drive.ratio * drive.rotor_inertia * detail::rate_of(d, a);
    }
    if (outcome && !detail::finite(out, Robot::drives)) return {};  // before a limit hides it
    for (int d = 0; outcome && d < Robot::drives; ++d)
      cut(options.joint_effort_limit[d], out[d], outcome.limited[d]);
    return outcome;
  }

  static void cut(double limit, double& value, bool& limited) noexcept {
    limited = limited || std::fabs(value) > limit;
    value = std::fmax(-limit, std::fmin(limit, value));
  }

  // Move z on to the positions q: z <- clip(z + dq / way, -1, 1).
  static void travel(const double* q, const double* way, Travelled& travelled) noexcept {
    double moved[Robot::freedoms] = {};
    for (int i = 0; i < Robot::freedoms; ++i) {
      if (travelled.begun) moved[i] = q[i] - travelled.before[i];
      if (moved[i] > pi) moved[i] -= 2.0 * pi;  // an angle that was counted from the other side
      if (moved[i] < -pi) moved[i] += 2.0 * pi;
      travelled.before[i] = q[i];
    }
    travelled.begun = true;
    for (int d = 0; d < Robot::drives; ++d) {
      if (!(way[d] > 0.0)) continue;
      const double drive = travelled.drive[d] + detail::rate_of(d, moved) / way[d];
      const double joint = travelled.joint[d] + moved[d] / way[d];
      travelled.drive[d] = std::fmax(-1.0, std::fmin(1.0, drive));
      travelled.joint[d] = std::fmax(-1.0, std::fmin(1.0, joint));
    }
  }

  // measured: at v_now by measured_scale, else at v_ref.
  Outcome compensate(const double* effort, const double* load, const State& state,
                     const Options& options, bool measured, double* out) const noexcept {
    if (measured && state.v_ref.first()) return {};
    const double* v_ref = state.v_ref.first() ? state.v_ref.first() : state.v.first();
    if (measured) v_ref = state.v_now.first();
    const double* way = measured ? options.measured_way : presliding_way;
    const double* q_ref = state.q_ref.first() && !measured ? state.q_ref.first() : state.q.first();
    Travelled& travelled = measured ? measured_ : desired_;
    const double *e = or_zeros(state.error), *now = or_zeros(state.v_now);
    for (int i = 0; i < Robot::freedoms; ++i)
      if (!(q_ref[i] >= least_position[i] && q_ref[i] <= greatest_position[i])) return {};
    if (!state.q_ref.fits() || !v_ref || !state.v_ref.fits() || !state.error.fits() || !state.v_now.fits() ||
        !slow_enough(v_ref) || !slow_enough(now) ||
        !detail::within(e, Robot::freedoms, greatest_error) || !valid(options))
      return {};
    const bool moving = state.v_now.first() != nullptr, holds = moving && state.error.first();
    Directions to;
    bool watched = false;
    for (int d = 0; d < Robot::drives; ++d)
      if (way[d] > 0.0 && options.hold_error[d] > 0.0) return {};
    if (measured || presliding) travel(q_ref, way, travelled);
    for (int d = 0; d < Robot::drives; ++d) {
      const double band = options.switch_velocity[d], hold = options.hold_error[d];
      const double slow = options.hold_velocity[d];
      if ((hold > 0.0 && (!holds || !(slow > 0.0))) || (options.power[d] < inf && !moving)) return {};
      direct(v_ref[d], band, e[d], hold, now[d], slow, to.joint[d], to.joint_leaving[d]);
      to.drive[d] = to.joint[d];
      to.drive_leaving[d] = to.joint_leaving[d];
      if (Robot::coupled)
        direct(detail::rate_of(d, v_ref), band, detail::rate_of(d, e), hold, detail::rate_of(d, now),
               slow, to.drive[d], to.drive_leaving[d]);
      if (way[d] > 0.0) {
        to.drive[d] = travelled.drive[d];
        to.joint[d] = travelled.joint[d];
      }
      watched |= options.power[d] < inf;
    }
    double dry[Robot::drives], drag[Robot::drives];
    friction_of(effort, load, v_ref, to, dry, drag);
    for (int d = 0; d < Robot::drives; ++d)
      out[d] = measured ? options.measured_scale[d] * (dry[d] + drag[d])
                        : options.scale[d] * dry[d] + options.viscous_scale[d] * drag[d];
    Outcome outcome;
    if (!detail::finite(out, Robot::drives)) return outcome;  // before a limit hides it
    for (int d = 0; d < Robot::drives; ++d) cut(options.limit[d], out[d], outcome.limited[d]);
    if (watched) watch_power(effort, load, now, options, out);
    if (!detail::finite(out, Robot::drives)) return {};
    outcome.good = true;
    return outcome;
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

}  // namespace constants_@@HASH
}  // namespace pinfric_scene

#endif
