// Medians of one call each, timed in turn: `motor_torque` beside Pinocchio's `rnea`.
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/multibody.hpp>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <random>
#include <vector>

#include "@@HEADER"

using namespace pinfric_scene;

int main() {
  pinocchio::Model model;
  // @@MODEL
  pinocchio::Data data(model);
  constexpr int n = Robot::freedoms, states = 500, rounds = 41;
  if (model.nv != n || model.nq != n) return 1;
  std::mt19937 random(0);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<Eigen::VectorXd> q, v, a;
  for (int i = 0; i < states; ++i)
    for (auto* x : {&q, &v, &a})
      x->push_back(Eigen::VectorXd::NullaryExpr(n, [&] { return uniform(random); }));
  const Compensator compensator;
  const Options options;
  InverseInstant instant;
  bool good = true;
  std::vector<State> moving(states);
  for (int i = 0; i < states; ++i) {
    moving[i].q = Freedoms::at(q[i].data());
    moving[i].v = Freedoms::at(v[i].data());
    moving[i].a = Freedoms::at(a[i].data());
  }
  double out[Robot::drives], sum = 0.0, worst = 0.0;
  for (int i = 0; i < states; ++i) {
    pinocchio::rnea(model, data, q[i], v[i], a[i]);
    good = compensator.rigid_body(moving[i], out) && good;
    for (int k = 0; k < n; ++k) worst = std::max(worst, std::fabs(out[k] - data.tau[k]));
  }
  std::vector<double> times[2];
  for (int round = 0; round < rounds; ++round)
    for (int which = 0; which < 2; ++which) {
      const auto start = std::chrono::steady_clock::now();
      for (int i = 0; i < states; ++i) {
        if (which == 0) {
          sum += pinocchio::rnea(model, data, q[i], v[i], a[i])[0];
        } else {
          good = compensator.motor_torque(moving[i], options, out, instant) && good;
          sum += out[0];
        }
      }
      const std::chrono::duration<double> passed = std::chrono::steady_clock::now() - start;
      times[which].push_back(1e6 * passed.count() / states);
    }
  for (auto& row : times) std::sort(row.begin(), row.end());
  const double rnea = times[0][rounds / 2], ours = times[1][rounds / 2];
  std::printf("rnea %.3f us, motor_torque %.3f us, ratio %.2f; rigid bodies differ by %.1g (%g)\n", rnea,
              ours, ours / rnea, worst, sum > 1e300 ? sum : 0.0);
  return good ? 0 : 1;
}
