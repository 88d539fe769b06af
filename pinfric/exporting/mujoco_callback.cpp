// The friction of `pf.mujoco_friction` as callbacks of MuJoCo: the law of mujoco_bridge.py, with the
// constants and laws of the header. The user sensor `memory` is called last in a step, when forces
// are known, and keeps what the next step needs; the control callback of the next step sets its
// limits. All that changes stands in mjData, so that threads with data of their own do not meet.
#include "pinfric_scene.hpp"

#include <mujoco/mujoco.h>

#include <atomic>
#include <cstdint>
#include <memory>
#include <vector>

namespace {

using namespace pinfric_scene;

constexpr int joints = Robot::drives;
constexpr double least = @@LEAST, held = @@HELD;

struct Place {
  int joint, body, root, dof, position;
  int row;      // of its body in the header
  bool counts;  // it rubs or has a gear
  double own, share;  // armature of the link (kg m^2 or kg), M/(M + J)
  double armature, damping;  // that friction wrote
};
struct Last {  // of one joint in the last step; the memory is time, and one of these per joint
  double used, force, beside, acceleration, warm, q, v, wrench[6];
};
struct Follower {  // a joint that an equality moves with that of a drive, which carries it
  int joint, body, root, dof, row, drive;
  double ratio, own;
};
static_assert(sizeof(Last) == @@LAST * sizeof(double), "the sensor's size counts on it");

// One friction of this scene, in one model and its copies: the model's mark says which.
struct Set {
  double mark = 0.0;
  int mark_at = 0;  // in the model's custom numbers
  Place places[joints] = {};
  double scale[Robot::sites > 0 ? Robot::sites : 1] = {};  // of the friction of joints
  std::vector<Follower> followers;
  std::vector<int> joint_of;  // of each degree of freedom; -1: none of those that count
  int memory = 0, first = -1;  // of the joints that count
  double timestep = 0.0;
  std::uint64_t model_signature = 0;
  std::atomic<int> jammed{-1};
  std::atomic<bool> changed{false};  // time step, integrator, flags or what friction wrote
};
std::vector<std::unique_ptr<Set>> sets;

// That of a model, or null: callbacks are global. By the mark, for alike robots have one signature.
Set* set_of(const mjModel* m) {
  for (const auto& set : sets)
    if (m->signature == set->model_signature && m->numeric_data[set->mark_at] == set->mark)
      return set.get();
  return nullptr;
}

int friction_rows(const mjData* d) {
  int end = d->ne;
  while (end < d->ne + d->nf && d->efc_type[end] == mjCNSTR_FRICTION_DOF) ++end;
  return end;
}

// MuJoCo's solver reads the copies of its islands where there are any.
void write(const Set& set, mjData* d, const double* limit) {
  for (int row = d->ne, end = friction_rows(d); row < end; ++row) {
    const int j = set.joint_of[static_cast<unsigned>(d->efc_id[row])];
    if (j < 0) continue;
    d->efc_frictionloss[row] = limit[j];
    if (d->nisland > 0 && d->efc_island[row] >= 0)
      d->iefc_frictionloss[d->map_efc2iefc[row]] = limit[j];
  }
}

// The force of a stop on its joint.
double stop_force(const mjModel* m, const mjData* d, int row) {
  const int id = d->efc_id[row];
  const double q = d->qpos[m->jnt_qposadr[id]];
  const bool below = 2.0 * q < m->jnt_range[2 * id] + m->jnt_range[2 * id + 1];
  return below ? d->efc_force[row] : -d->efc_force[row];
}

// The reaction at a body's joint, in the axes of the header.
struct Reaction { detail::Vector force, moment; };
Reaction reaction(const mjData* d, int body, int root, int row) {
  const mjtNum *wrench = d->cfrc_int + 6 * body, *R = d->xmat + 9 * body;
  const mjtNum *com = d->subtree_com + 3 * root, *place = d->xpos + 3 * body;
  const detail::Vector force = {wrench[3], wrench[4], wrench[5]};
  const detail::Vector arm = {com[0] - place[0], com[1] - place[1], com[2] - place[2]};
  const detail::Vector moment =
      detail::sum({wrench[0], wrench[1], wrench[2]}, detail::cross(arm, force));
  const double* turn = bodies[row].turn;
  return {detail::turned(turn, detail::turned_back(R, force)),
          detail::turned(turn, detail::turned_back(R, moment))};
}

// What a solved step says of its friction.
void read(const Set& set, const mjModel* m, mjData* d, Last* last) {
  mj_rnePostConstraint(m, d);
  for (int j = 0; j < joints; ++j) {
    const Place& at = set.places[j];
    const auto [f, n] = reaction(d, at.body, at.root, at.row);
    last[j] = {0.0, 0.0, d->qfrc_spring[at.dof], d->qacc[at.dof], d->qacc_warmstart[at.dof],
               d->qpos[at.position], d->qvel[at.dof], {f.x, f.y, f.z, n.x, n.y, n.z}};
  }
  for (int row = d->ne, end = friction_rows(d); row < end; ++row) {
    const int j = set.joint_of[static_cast<unsigned>(d->efc_id[row])];
    if (j < 0) continue;
    last[j].used = d->efc_frictionloss[row];
    last[j].force = d->efc_force[row];
  }
  for (int row = d->ne + d->nf; d->nl && row < d->nefc; ++row) {
    if (d->efc_type[row] != mjCNSTR_LIMIT_JOINT) continue;
    const int j = set.joint_of[static_cast<unsigned>(m->jnt_dofadr[d->efc_id[row]])];
    if (j >= 0) last[j].beside += stop_force(m, d, row);
    for (const Follower& one : set.followers)
      if (one.joint == d->efc_id[row])
        last[one.drive].beside += one.ratio * stop_force(m, d, row);
  }
  for (const Follower& one : set.followers) {
    const auto [f, n] = reaction(d, one.body, one.root, one.row);
    const double taken = bodies[one.row].turns ? n.z : f.z;
    last[one.drive].beside -=
        one.ratio * (taken + one.own * d->qacc[one.dof] - d->qfrc_spring[one.dof]);
  }
}

// The limit of one joint in the next step.
double limit_of(Set& set, int j, const Last& last, double q, double velocity, double direction, bool sticks,
                bool damped) {
  const Place& at = set.places[j];
  const double way = direction < 0.0 ? -1.0 : 1.0, v = sticks ? 0.0 : velocity, speed = std::fabs(v);
  const double tau =
      last.wrench[bodies[at.row].turns ? 5 : 2] + at.own * last.acceleration - last.beside;
  const int side = way > 0.0 ? 0 : 1;
  double dry = 0.0, drag = 0.0, viscous = 0.0;
  for (int s = 0; s < Robot::sites; ++s) {
    const Site& site = sites[s];
    if (site.body != at.row) continue;
    const double c = detail::normal_load(site, last.wrench, q);
    if (sticks) {
      dry = site.mu_static * c + site.coulomb_static[side];
    } else {
      const detail::Moving now = detail::friction_at(site, std::fmax(speed, 1e-300));
      dry = now.mu * c + now.coulomb[side];
      drag = now.drag_mu * c + now.drag[side];
      viscous = site.viscous * v;
    }
    dry *= set.scale[s];
    drag *= set.scale[s];
    viscous *= set.scale[s];
  }
  const double leaving = sticks ? 1.0 : 0.0, t = tau + way * (dry + drag) + viscous;
  const detail::GearLine line = detail::gear_line(j, way, speed, leaving, t);
  double found = way * (line.slope * t + line.offset - tau - viscous);
  if (drives[j].power != 1.0) found += std::fabs(detail::motor_drag(j, v));
  if (sticks) {  // a self-locking gear may need more for the load that friction lets it bear
    const double other = tau - way * dry;
    found = std::fmax(found, way * (detail::gear_value(j, way, 0.0, 1.0, other) - tau));
  } else if (damped) {
    const double gain = 1.0 + (line.slope - 1.0) * at.share;
    if (gain > 0.0)
      found = last.used + (found - last.used) / gain;
    else
      set.jammed = j;
  }
  return std::fmax(found, least);
}

// The limits of a motion that begins here: joints at or below their stick velocity rest.
void start(Set& set, const mjModel* m, mjData* d, double* limit) {
  bool rests[joints];
  for (int j = 0; j < joints; ++j) {
    rests[j] = std::fabs(d->qvel[set.places[j].dof]) <= drives[j].stick_velocity;
    limit[j] = rests[j] ? held : least;
  }
  Last last[joints];
  for (int pass = 0; pass < 2; ++pass) {  // the second: with the friction of what moves
    write(set, d, limit);
    mj_fwdActuation(m, d);
    mj_fwdAcceleration(m, d);
    mj_fwdConstraint(m, d);
    read(set, m, d, last);
    for (int j = 0; j < joints; ++j) {
      const double v = d->qvel[set.places[j].dof], q = d->qpos[set.places[j].position];
      const double found = limit_of(set, j, last[j], q, v, rests[j] ? -last[j].force : v, rests[j], false);
      limit[j] = rests[j] && pass == 0 ? held : found;
    }
  }
}

// Whether the step in `memory` led to this state (1), was taken at it (0), or neither (-1).
// A rollout begins without a warm start, so none goes on where another one happened to end.
int steps_since(const Set& set, const mjModel* m, const mjData* d, const mjtNum* kept, const Last* last) {
  const int steps = d->time == kept[0] ? 0 : 1;
  if (!(last[set.first].used > 0.0) || (steps == 1 && d->time != kept[0] + m->opt.timestep)) return -1;
  bool warm = false;
  for (int j = 0; j < joints; ++j) {
    const Place& at = set.places[j];
    const double q = d->qpos[at.position], v = d->qvel[at.dof], start = d->qacc_warmstart[at.dof];
    warm = warm || start != 0.0;
    if (steps == 0 && (q != last[j].q || v != last[j].v || start != last[j].warm)) return -1;
    const double far = std::fabs(q - (last[j].q + m->opt.timestep * v));
    if (steps == 1 && (start != d->qacc[at.dof] || far > 1e-12 * (1.0 + std::fabs(q)))) return -1;
  }
  return warm ? steps : -1;
}

}  // namespace

extern "C" {

// mark: of the model, at mark_at of its numbers. joint ... counts: one per drive. scale: of each
// site's friction. led: joint, row, drive and ratio, armature of each follower. memory_at: the
// sensor's first number.
void pinfric_set_@@SCENE(const mjModel* m, double mark, int mark_at, const int* joint,
                         const int* row, const double* own, const double* share, const int* counts,
                         const int* led, const double* led_by, const double* scale, int led_count,
                         int memory_at) {
  auto set = std::make_unique<Set>();
  set->mark = mark;
  set->mark_at = mark_at;
  for (int k = 0; k < led_count; ++k, led += 3, led_by += 2) {
    const int body = m->jnt_bodyid[led[0]];
    set->followers.push_back({led[0], body, m->body_rootid[body], m->jnt_dofadr[led[0]], led[1],
                              led[2], led_by[0], led_by[1]});
  }
  for (int s = 0; s < Robot::sites; ++s) set->scale[s] = scale[s];
  set->joint_of.assign(static_cast<unsigned>(m->nv), -1);
  for (int j = 0; j < joints; ++j) {
    const int id = joint[j], body = m->jnt_bodyid[id], dof = m->jnt_dofadr[id];
    set->places[j] = {id, body, m->body_rootid[body], dof, m->jnt_qposadr[id], row[j],
                      counts[j] != 0, own[j], share[j], m->dof_armature[dof], m->dof_damping[dof]};
    if (counts[j]) set->joint_of[static_cast<unsigned>(dof)] = j;
    if (counts[j] && set->first < 0) set->first = j;
  }
  set->memory = memory_at;
  set->timestep = m->opt.timestep;
  set->model_signature = m->signature;
  sets.push_back(std::move(set));
}

// The drive that jammed, or -1; -2: the time step, the integrator, a flag, armature or damping is
// another. The friction of that mark is taken away.
int pinfric_remove_@@SCENE(double mark) {
  int failed = -1;
  for (auto at = sets.begin(); at != sets.end(); ++at)
    if ((*at)->mark == mark) {
      failed = (*at)->changed ? -2 : (*at)->jammed.load();
      sets.erase(at);
      break;
    }
  return failed;
}

// Whether the model is one of those that this scene's frictions are in but for its mark.
bool pinfric_alike_@@SCENE(const mjModel* m, double* mark) {
  for (const auto& set : sets)
    if (m->signature == set->model_signature) {
      *mark = m->numeric_data[set->mark_at];
      return true;
    }
  return false;
}

void pinfric_control_@@SCENE(const mjModel* m, mjData* d) {
  Set* found = set_of(m);
  if (!found) return;
  Set& set = *found;
  if (m->opt.timestep != set.timestep || m->opt.integrator == mjINT_RK4 ||
      (m->opt.disableflags & @@REFUSED) != 0)
    set.changed = true;
  for (const Place& at : set.places)
    if (at.counts && (m->dof_armature[at.dof] != at.armature || m->dof_damping[at.dof] != at.damping))
      set.changed = true;
  if (set.first < 0) return;
  const mjtNum* kept = d->sensordata + set.memory;
  const Last* last = reinterpret_cast<const Last*>(kept + 1);
  double limit[joints];
  const int steps = steps_since(set, m, d, kept, last);
  if (steps < 0) start(set, m, d, limit);
  for (int j = 0; steps >= 0 && j < joints; ++j) {
    const double v = d->qvel[set.places[j].dof], q = d->qpos[set.places[j].position];
    const bool sticks = std::fabs(last[j].force) < (1.0 - 1e-12) * last[j].used;
    const bool fast = !sticks && std::fabs(v) > drives[j].stick_velocity;
    limit[j] = steps == 0 ? last[j].used
                          : limit_of(set, j, last[j], q, v, fast ? v : -last[j].force, sticks, true);
  }
  write(set, d, limit);
}

void pinfric_sensor_@@SCENE(const mjModel* m, mjData* d, int stage) {
  if (stage != mjSTAGE_ACC) return;
  const Set* set = set_of(m);
  if (!set) return;
  d->sensordata[set->memory] = d->time;
  read(*set, m, d, reinterpret_cast<Last*>(d->sensordata + set->memory + 1));
}

}  // extern "C"
