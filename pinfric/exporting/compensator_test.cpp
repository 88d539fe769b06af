// Holds a compensator against the states that pinfric computed when it wrote the header.
//
//   c++ -std=c++17 -O2 THIS_FILE -o check
//   ./check                   compares the embedded states: ends with 0 where all agree, else with 1
//   ./check trajectory.csv    replays a trajectory that pinfric wrote (t, JOINT, JOINT.v, JOINT.a):
//                             of each row friction, feed-forward and interval of each motor
#include "@@HEADER"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>
#include <vector>

namespace {

using namespace pinfric_scene;

struct Embedded {
  double q[Robot::freedoms], v[Robot::freedoms], a[Robot::freedoms];
  double least[Robot::drives], greatest[Robot::drives], friction[Robot::drives];
};

const Embedded states[] = {
// @@STATES
};

constexpr double tolerance = 1e-9;  // of each column's peak

State state_of(const double* q, const double* v, const double* a) {
  State state;
  state.q = Freedoms::at(q);
  state.v = Freedoms::at(v);
  state.a = Freedoms::at(a);
  return state;
}

Options whole() {
  Options options;
  for (int d = 0; d < Robot::drives; ++d) {
    options.limit[d] = options.joint_effort_limit[d] = inf;
  }
  return options;
}

// The largest difference of one column from what is embedded, as a part of the column's peak.
struct Difference {
  double peak = 0.0, largest = 0.0;
  void add(double found, double expected) {
    peak = std::fmax(peak, std::fabs(expected));
    largest = std::fmax(largest, std::fabs(found - expected));
  }
  bool agrees() const { return largest <= tolerance * peak + 1e-15; }
};

int compare() {
  const Compensator compensator;
  const Options options = whole();
  Difference least[Robot::drives], greatest[Robot::drives], friction[Robot::drives];
  bool good = true;
  for (const Embedded& state : states) {
    InverseInstant instant;
    double out[Robot::drives];
    const State now = state_of(state.q, state.v, state.a);
    good &= compensator.inverse(now, instant);
    good &= static_cast<bool>(compensator.friction(now, options, out));
    for (int d = 0; d < Robot::drives; ++d) {
      least[d].add(instant.motor_torque_lower[d], state.least[d]);
      greatest[d].add(instant.motor_torque_upper[d], state.greatest[d]);
      friction[d].add(out[d], state.friction[d]);
    }
  }
  for (int d = 0; d < Robot::drives; ++d) {
    const bool agrees = least[d].agrees() && greatest[d].agrees() && friction[d].agrees();
    std::printf("%s: motor torque %.2g and %.2g of %.4g N m, friction %.2g of %.4g: %s\n",
                Robot::drive_names[d], least[d].largest, greatest[d].largest, greatest[d].peak,
                friction[d].largest, friction[d].peak, agrees ? "agrees" : "DIFFERS");
    good &= agrees;
  }
  return good ? 0 : 1;
}

std::vector<std::string> cells(const std::string& line) {
  std::vector<std::string> found(1);
  for (const char c : line) {
    if (c == ',') found.emplace_back();
    else if (c != '\r') found.back() += c;
  }
  return found;
}

// The number in a cell; NaN where it is none.
double number(const std::string& cell) {
  char* end = nullptr;
  const double found = std::strtod(cell.c_str(), &end);
  return end != cell.c_str() && *end == '\0' ? found : NAN;
}

// Columns of positions, velocities and accelerations; empty where one is missing.
std::vector<std::size_t> columns(const std::vector<std::string>& header) {
  std::vector<std::size_t> found;
  for (const char* suffix : {"", ".v", ".a"})
    for (const char* name : Robot::freedom_names) {
      std::size_t column = 0;
      while (column < header.size() && header[column] != std::string(name) + suffix) ++column;
      if (column == header.size()) {
        std::fprintf(stderr, "column %s%s is missing\n", name, suffix);
        return {};
      }
      found.push_back(column);
    }
  return found;
}

int replay(const char* name) {
  std::ifstream file(name);
  std::string line;
  if (!std::getline(file, line)) {
    std::fprintf(stderr, "%s cannot be read\n", name);
    return 1;
  }
  const std::vector<std::string> header = cells(line);
  const std::vector<std::size_t> at = columns(header);
  if (at.empty()) return 1;
  for (const std::string& column : header)
    if (column.rfind("payload.", 0) == 0)
      std::fprintf(stderr, "column %s is not read: nothing is carried here, see add_payload\n",
                   column.c_str());
  const Compensator compensator;
  const Options options = whole();
  std::printf("t");
  for (const char* drive : Robot::drive_names)
    std::printf(",%s.friction,%s.feed_forward,%s.least,%s.greatest", drive, drive, drive, drive);
  std::printf("\n");
  for (int row = 2; std::getline(file, line); ++row) {
    const std::vector<std::string> given = cells(line);
    double state[3 * Robot::freedoms], friction[Robot::drives], motor[Robot::drives];
    bool good = true;
    for (std::size_t i = 0; i < at.size(); ++i) {
      good = good && at[i] < given.size();
      state[i] = good ? number(given[at[i]]) : NAN;
    }
    const State now = state_of(state, state + Robot::freedoms, state + 2 * Robot::freedoms);
    InverseInstant instant;
    good = good && compensator.motor_torque(now, options, motor, instant) &&
           compensator.friction(now, options, friction);
    if (!good) {
      std::fprintf(stderr, "%s: line %d is no state of the robot\n", name, row);
      return 1;
    }
    std::printf("%s", given[0].c_str());
    for (int d = 0; d < Robot::drives; ++d)
      std::printf(",%.17g,%.17g,%.17g,%.17g", friction[d], motor[d], instant.motor_torque_lower[d],
                  instant.motor_torque_upper[d]);
    std::printf("\n");
  }
  return 0;
}

}  // namespace

int main(int count, char** arguments) { return count > 1 ? replay(arguments[1]) : compare(); }
