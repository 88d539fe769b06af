// A chainable controller of ros2_control that knows the friction of pinfric_scene's robot: see
// controllers.yaml. Made by pinfric; the law is that of @@HEADER.
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "controller_interface/chainable_controller_interface.hpp"
#include "pluginlib/class_list_macros.hpp"
#include "rclcpp/rclcpp.hpp"

#include "@@HEADER"

namespace pinfric_scene {
inline namespace @@INNER {

// Reference interfaces of each joint: position, velocity, acceleration, and an effort that is added.
// State interfaces: position, velocity. Command interface: effort, in N m or N at the joint, with
// rigid body and rotors (but for `rigid_body: false`).
class Controller : public controller_interface::ChainableControllerInterface {
  static constexpr int n = Robot::freedoms;
  static_assert(Robot::drives == n && !Robot::coupled, "a joint has a drive of its own");
  using Numbers = std::array<double, static_cast<std::size_t>(n)>;
  using Result = controller_interface::return_type;
  using Callback = controller_interface::CallbackReturn;
  using Duration = rclcpp::Duration;

  // What the user gave, by the names of the parameters.
  struct Given {
    bool guide = false, rigid_body = true;
    std::string prefix, frame;
    std::vector<std::string> joints;
    std::map<std::string, std::vector<double>> numbers;
  };
  // What a cycle needs, without memory of its own.
  struct Settings {
    bool guide = false, rigid_body = true;
    Options options;
    double stiffness[n] = {}, damping[n] = {};
    int frame = -1;
    double mass = 0.0, com[3] = {}, inertia[6] = {};
  };
  struct Motion { double q[n], v[n], q_ref[n], v_ref[n], a_ref[n], effort[n]; };

 public:
  Callback on_init() override {
    try {
      given_.guide = auto_declare<bool>("guide", false);
      given_.rigid_body = auto_declare<bool>("rigid_body", true);
      given_.prefix = auto_declare<std::string>("prefix", "");
      given_.joints = auto_declare<std::vector<std::string>>("joints", {});
      given_.frame = auto_declare<std::string>("payload.frame", "");
      for (const char* name : numbers)
        given_.numbers[name] = auto_declare<std::vector<double>>(name, {});
    } catch (const std::exception& problem) {
      RCLCPP_ERROR(get_node()->get_logger(), "%s", problem.what());
      return Callback::ERROR;
    }
    changed_ = get_node()->add_on_set_parameters_callback(
        [this](const std::vector<rclcpp::Parameter>& asked) { return change(asked); });
    return Callback::SUCCESS;
  }

  Callback on_configure(const rclcpp_lifecycle::State&) override {
    Settings settings;
    const std::string wrong = settle(given_, settings);
    if (!wrong.empty()) {
      RCLCPP_ERROR(get_node()->get_logger(), "%s", wrong.c_str());
      return Callback::FAILURE;
    }
    prefix_ = given_.prefix;
    configured_ = true;
    hand_over(settings);
    return Callback::SUCCESS;
  }

  Callback on_cleanup(const rclcpp_lifecycle::State&) override {
    configured_ = false;
    return Callback::SUCCESS;
  }

  controller_interface::InterfaceConfiguration command_interface_configuration() const override {
    return named({"effort"});
  }

  controller_interface::InterfaceConfiguration state_interface_configuration() const override {
    return named({"position", "velocity"});
  }

  // The references are those of the posture in which it is activated, at rest, until others come.
  Callback on_activate(const rclcpp_lifecycle::State&) override {
    compensator_.reset();
    said_ = false;
    for (int i = 0; i < n; ++i) {
      const double q = state(i);
      if (!std::isfinite(q)) {
        RCLCPP_ERROR(get_node()->get_logger(), "%s: no position is measured", joint(i).c_str());
        return Callback::ERROR;
      }
      if (!refer(0, i, q) || !refer(1, i, 0.0) || !refer(2, i, 0.0) || !refer(3, i, 0.0))
        return Callback::ERROR;
    }
    return Callback::SUCCESS;
  }

  Callback on_deactivate(const rclcpp_lifecycle::State&) override {
    for (auto& command : command_interfaces_)
      if (!command.set_value(0.0)) return Callback::ERROR;
    return Callback::SUCCESS;
  }

 protected:
  std::vector<hardware_interface::CommandInterface::SharedPtr> on_export_reference_interfaces_list()
      override {
    std::vector<hardware_interface::CommandInterface::SharedPtr> references;
    for (const char* kind : {"position", "velocity", "acceleration", "effort"})
      for (int i = 0; i < n; ++i)
        references.push_back(std::make_shared<hardware_interface::CommandInterface>(
            std::string(get_node()->get_name()) + "/" + joint(i), kind));
    return references;
  }

  // Not chained, it holds the references of its activation.
  Result update_reference_from_subscribers(const rclcpp::Time&, const Duration&) override {
    return Result::OK;
  }

  // All commands of a cycle are written, or none.
  Result update_and_write_commands(const rclcpp::Time&, const Duration&) override {
    take_over();
    Motion now;
    for (int i = 0; i < n; ++i) {
      now.q[i] = state(i);
      now.v[i] = state(n + i);
      now.q_ref[i] = reference(0, i);
      now.v_ref[i] = reference(1, i);
      now.a_ref[i] = reference(2, i);
      now.effort[i] = reference(3, i);
    }
    double out[n];
    if (!effort_of(compensator_, settings_, now, out)) {
      if (!said_)
        RCLCPP_ERROR(get_node()->get_logger(),
                     "a state or a reference is not finite, or far beyond what the joints can do: "
                     "nothing is commanded");
      said_ = true;
      return Result::ERROR;
    }
    said_ = false;
    bool written = true;
    for (int i = 0; i < n; ++i)
      written = command_interfaces_[static_cast<std::size_t>(i)].set_value(out[i]) && written;
    return written ? Result::OK : Result::ERROR;
  }

 private:
  static constexpr const char* numbers[] = {
      "scale",         "measured_scale", "switch_velocity", "hold_error",  "hold_velocity",
      "stiffness",     "damping",        "payload.mass",    "payload.com", "payload.inertia"};

  Compensator compensator_;
  Settings settings_;
  Given given_;
  std::string prefix_;
  bool configured_ = false, said_ = false;
  rclcpp::node_interfaces::OnSetParametersCallbackHandle::SharedPtr changed_;
  std::mutex mutex_;  // of what stands between the parameters' thread and the loop
  Settings next_;
  bool fresh_ = false;

  std::string joint(int i) const { return prefix_ + Robot::freedom_names[i]; }

  controller_interface::InterfaceConfiguration named(std::vector<const char*> kinds) const {
    controller_interface::InterfaceConfiguration all;
    all.type = controller_interface::interface_configuration_type::INDIVIDUAL;
    for (const char* kind : kinds)
      for (int i = 0; i < n; ++i) all.names.push_back(joint(i) + "/" + kind);
    return all;
  }

  double state(int k) const {
    return state_interfaces_[static_cast<std::size_t>(k)].get_optional().value_or(std::nan(""));
  }

  double reference(int kind, int i) const {
    const auto& all = ordered_exported_reference_interfaces_;
    return all[static_cast<std::size_t>(kind * n + i)]->get_optional().value_or(std::nan(""));
  }

  bool refer(int kind, int i, double value) {
    return ordered_exported_reference_interfaces_[static_cast<std::size_t>(kind * n + i)]->set_value(
        value);
  }

  // The efforts of a state; false where the law refuses it.
  static bool effort_of(const Compensator& compensator, const Settings& settings, const Motion& now,
                        double* out) {
    State state;
    double error[n], rigid[n] = {};
    for (int i = 0; i < n; ++i) {
      if (!(now.q[i] >= least_position[i] && now.q[i] <= greatest_position[i])) return false;
      error[i] = apart(i, now.q_ref[i] - now.q[i]);
    }
    state.v_now = now.v;
    if (settings.guide) {  // no motion is desired: the load is that of gravity
      state.q = now.q;
      if (!compensator.friction_measured(state, settings.options, Drives::at(out))) return false;
      if (!compensator.rigid_body(state, rigid)) return false;
    } else {
      state.q = now.q_ref;
      state.v = now.v_ref;
      state.a = now.a_ref;
      state.error = error;
      const Drives all = Drives::at(out);
      const Outcome found = settings.rigid_body
                                ? compensator.joint_effort(state, settings.options, all)
                                : compensator.friction(state, settings.options, all);
      if (!found) return false;
    }
    for (int i = 0; i < n; ++i) {
      if (settings.guide) {
        if (settings.rigid_body) out[i] += rigid[i];
      } else {
        out[i] += settings.stiffness[i] * error[i] + settings.damping[i] * (now.v_ref[i] - now.v[i]);
      }
      out[i] += now.effort[i];
      if (!std::isfinite(out[i])) return false;
      const double limit = settings.options.joint_effort_limit[i];
      out[i] = std::fmax(-limit, std::fmin(limit, out[i]));
    }
    return true;
  }

  // The difference of two positions, of a joint that turns without end at most half a turn.
  static double apart(int i, double difference) {
    bool turns = false;
    for (const Body& body : bodies) turns |= body.freedom == i && body.turns;
    return turns && greatest_position[i] >= 1e6 ? std::remainder(difference, 2.0 * pi) : difference;
  }

  // The settings that were given, or what is wrong with them.
  static std::string settle(const Given& given, Settings& out) {
    out = Settings();
    out.guide = given.guide;
    out.rigid_body = given.rigid_body;
    std::string names;
    bool same = given.joints.empty() || given.joints.size() == static_cast<std::size_t>(n);
    for (int i = 0; i < n; ++i) {
      names += (i ? ", " : "") + given.prefix + Robot::freedom_names[i];
      same = same && (given.joints.empty() || given.joints[static_cast<std::size_t>(i)] ==
                                                  given.prefix + Robot::freedom_names[i]);
    }
    if (!same) return "joints: should be, in this order, " + names;
    Options& o = out.options;
    const auto spread = [&given](const char* name, double* values) {
      const std::vector<double>& all = given.numbers.at(name);
      if (all.size() > 1 && all.size() != static_cast<std::size_t>(n)) return false;
      for (int i = 0; i < n && !all.empty(); ++i)
        values[i] = all[all.size() == 1 ? 0 : static_cast<std::size_t>(i)];
      return true;
    };
    const std::map<const char*, double*> places = {
        {"scale", o.scale},           {"measured_scale", o.measured_scale},
        {"hold_error", o.hold_error}, {"switch_velocity", o.switch_velocity},
        {"stiffness", out.stiffness}, {"hold_velocity", o.hold_velocity},
        {"damping", out.damping}};
    for (const auto& [name, values] : places)
      if (!spread(name, values))
        return std::string(name) + ": should have one number, or one for each of " + names;
    spread("scale", o.viscous_scale);
    for (int i = 0; i < n; ++i)
      if (!(out.stiffness[i] >= 0.0) || !(out.damping[i] >= 0.0) || !std::isfinite(out.stiffness[i]) ||
          !std::isfinite(out.damping[i]))
        return "stiffness, damping: should be finite and not negative";
    const auto& mass = given.numbers.at("payload.mass");
    const auto& com = given.numbers.at("payload.com");
    const auto& inertia = given.numbers.at("payload.inertia");
    if (mass.size() > 1 || (!com.empty() && com.size() != 3) || (!inertia.empty() && inertia.size() != 6))
      return "payload: should have mass [kg], com [x, y, z], inertia [xx, xy, xz, yy, yz, zz]";
    for (int f = 0; f < Robot::frame_count; ++f)
      if (given.frame == Robot::frames[f]) out.frame = f;
    out.mass = mass.empty() ? 0.0 : mass[0];
    for (std::size_t k = 0; k < com.size(); ++k) out.com[k] = com[k];
    for (std::size_t k = 0; k < inertia.size(); ++k) out.inertia[k] = inertia[k];
    if (out.frame < 0 && (!given.frame.empty() || out.mass != 0.0)) {
      std::string links;
      for (int f = 0; f < Robot::frame_count; ++f)
        links += std::string(f ? ", " : "") + Robot::frames[f];
      return "payload.frame: should be one of " + links;
    }
    Compensator trial;
    if (!carry(trial, out))
      return "payload: no body has such a mass, centre (m) and inertia (kg m^2)";
    Motion rest = {};
    for (int i = 0; i < n; ++i)
      rest.q[i] = rest.q_ref[i] = std::fmax(least_position[i], std::fmin(greatest_position[i], 0.0));
    double effort[n];
    if (!effort_of(trial, out, rest, effort))
      return "scale, measured_scale, switch_velocity, hold_error or hold_velocity: negative, or "
             "without effect (hold_error with guide or where friction builds up over a way), or "
             "measured_scale above stable_scale of the header";
    return "";
  }

  static bool carry(Compensator& compensator, const Settings& settings) {
    compensator.clear_payloads();
    return settings.frame < 0 ||
           compensator.set_payload(settings.frame, settings.mass, settings.com, settings.inertia);
  }

  // New parameters: all are taken, or none.
  rcl_interfaces::msg::SetParametersResult change(const std::vector<rclcpp::Parameter>& asked) {
    rcl_interfaces::msg::SetParametersResult result;
    Given given = given_;
    for (const rclcpp::Parameter& parameter : asked) {
      const std::string& name = parameter.get_name();
      if (name == "guide") given.guide = parameter.as_bool();
      else if (name == "rigid_body") given.rigid_body = parameter.as_bool();
      else if (name == "prefix") given.prefix = parameter.as_string();
      else if (name == "joints") given.joints = parameter.as_string_array();
      else if (name == "payload.frame") given.frame = parameter.as_string();
      else if (given.numbers.count(name)) given.numbers[name] = parameter.as_double_array();
    }
    Settings settings;
    result.reason = settle(given, settings);
    if (configured_ && given.prefix != prefix_)
      result.reason = "prefix: names the interfaces, so clean the controller up before";
    result.successful = result.reason.empty();
    if (!result.successful) return result;
    given_ = given;
    if (configured_) hand_over(settings);
    return result;
  }

  void hand_over(const Settings& settings) {
    const std::lock_guard<std::mutex> lock(mutex_);
    next_ = settings;
    fresh_ = true;
  }

  void take_over() {  // in the loop, which does not wait
    const std::unique_lock<std::mutex> lock(mutex_, std::try_to_lock);
    if (!lock.owns_lock() || !fresh_) return;
    settings_ = next_;
    fresh_ = !carry(compensator_, settings_);
  }
};

}  // namespace @@INNER
}  // namespace pinfric_scene

PLUGINLIB_EXPORT_CLASS(pinfric_scene::Controller, controller_interface::ChainableControllerInterface)
