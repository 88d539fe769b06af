// Answers what test_cpp.py asks of several compensators at once; see `Headers` there.
#include <cstddef>
#include <cstdio>
#include <cstring>
#include <vector>

// @@INCLUDES

namespace {

void put(std::vector<double>& out, const double* values, int count) {
  out.insert(out.end(), values, values + count);
}

// One scene: payloads, wrenches, then states of q, v, a, v_ref, error, v_now; see `Headers.ask`.
template <class Robot, class Compensator, class Options, class Instant, class State, class View,
          class Drives, class Efforts>
bool answer(std::FILE* in, std::FILE* out) {
  double counts[6];  // payloads, wrenches, states, and whether v and a, error, v_now are given
  if (std::fread(counts, sizeof(double), 6, in) != 6) return false;
  Compensator compensator;
  double accepted = 1.0;
  for (int i = 0; i < static_cast<int>(counts[0]); ++i) {
    double x[11];
    if (std::fread(x, sizeof(double), 11, in) != 11) return false;
    double com[3], inertia[6];
    std::memcpy(com, x + 2, sizeof com);
    std::memcpy(inertia, x + 5, sizeof inertia);
    if (!compensator.add_payload(static_cast<int>(x[0]), x[1], com, inertia)) accepted = 0.0;
  }
  for (int i = 0; i < static_cast<int>(counts[1]); ++i) {
    double x[7];
    if (std::fread(x, sizeof(double), 7, in) != 7) return false;
    double wrench[6];
    std::memcpy(wrench, x + 1, sizeof wrench);
    if (!compensator.set_wrench(static_cast<int>(x[0]), wrench)) accepted = 0.0;
  }
  constexpr int nv = Robot::freedoms, na = Robot::drives, ns = Robot::sites;
  std::vector<double> row(std::size_t{7 * nv + 10 * na}), found;
  for (int i = 0; i < static_cast<int>(counts[2]); ++i) {
    if (std::fread(row.data(), sizeof(double), row.size(), in) != row.size()) return false;
    const double *q = row.data(), *v = q + nv, *a = v + nv, *v_ref = a + nv, *error = v_ref + nv,
                 *v_now = error + nv, *q_ref = v_now + nv, *settings = q_ref + nv;
    if (counts[3] == 0.0) v = a = nullptr;
    if (counts[4] == 0.0) error = nullptr;
    if (counts[5] == 0.0) v_now = nullptr;
    Options options;
    double* const fields[] = {options.scale, options.viscous_scale, options.switch_velocity,
                              options.hold_error, options.limit, options.power,
                              options.measured_scale, options.measured_way,
                              options.hold_velocity, options.joint_effort_limit};
    for (int f = 0; f < 10; ++f)
      for (int d = 0; d < na; ++d) fields[f][d] = settings[f * na + d];
    Instant instant, other;
    using Size = std::size_t;  // arrays of a template's sizes: g++ warns of any other
    double rigid[Size{Robot::freedoms}], friction[Size{Robot::drives}], motor[Size{Robot::drives}];
    double effort[Size{Robot::drives}], limited[Size{Robot::drives}], fed[Size{Robot::drives}];
    double flags[Size{Robot::sites} + 1], good[7];
    State state;
    state.q = View::at(q);
    state.v = View::at(v);
    state.a = View::at(a);
    state.error = View::at(error);
    state.v_now = View::at(v_now);
    const std::vector<double> zeros(std::size_t{nv});
    good[0] = accepted;
    good[1] = compensator.rigid_body(state, Efforts::at(rigid));
    good[2] = compensator.inverse(state, instant);
    state.v_ref = View::at(v_ref);
    state.q_ref = View::at(q_ref);
    const auto outcome = compensator.friction(state, options, Drives::at(friction));
    good[3] = outcome.good;
    for (int d = 0; d < na; ++d) limited[d] = outcome.limited[d];
    good[5] = compensator.joint_effort(state, options, Drives::at(effort)).good;
    state.v_ref = View();
    if (!v_now) state.v_now = View::at(v_ref);
    good[6] = compensator.friction_measured(state, options, Drives::at(fed)).good;
    state.v_now = View::at(v_now);
    state.v_ref = v ? View::at(v) : View(zeros);
    good[4] = compensator.motor_torque(state, options, Drives::at(motor), other).good;
    for (int s = 0; s < ns; ++s) flags[s] = instant.sticking[s];
    found.clear();
    put(found, good, 7);
    put(found, rigid, nv);
    put(found, friction, na);
    put(found, fed, na);
    put(found, limited, na);
    put(found, motor, na);
    put(found, effort, na);
    put(found, instant.effort_frictionless, na);
    put(found, instant.effort_lower, na);
    put(found, instant.effort_upper, na);
    put(found, instant.joint_effort_lower, na);
    put(found, instant.joint_effort_upper, na);
    put(found, instant.motor_torque_lower, na);
    put(found, instant.motor_torque_upper, na);
    put(found, instant.normal_load, ns);
    put(found, instant.friction_lower, ns);
    put(found, instant.friction_upper, ns);
    put(found, flags, ns);
    put(found, instant.wrench[0], 6 * ns);
    std::fwrite(found.data(), sizeof(double), found.size(), out);
  }
  return true;
}

}  // namespace

int main(int count, char** arguments) {
  if (count != 4) return 2;
  std::FILE* in = std::fopen(arguments[2], "rb");
  std::FILE* out = std::fopen(arguments[3], "wb");
  bool good = in != nullptr && out != nullptr;
  // @@SCENES
  if (in) std::fclose(in);
  if (out) std::fclose(out);
  return good ? 0 : 1;
}
