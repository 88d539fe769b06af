// As much of ros2_control as the controller uses, with the signatures of Jazzy and later.
#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "rclcpp/rclcpp.hpp"

namespace hardware_interface {
class Handle {
 public:
  using SharedPtr = std::shared_ptr<Handle>;
  explicit Handle(const std::string& prefix, const std::string& interface,
                  const std::string& = "double", const std::string& = "")
      : prefix_(prefix), name_(prefix + "/" + interface) {}
  const std::string& get_prefix_name() const { return prefix_; }
  const std::string& get_name() const { return name_; }
  template <class T = double> [[nodiscard]] std::optional<T> get_optional() const { return value; }
  template <class T> [[nodiscard]] bool set_value(const T& given) { value = given; return true; }
  double value = std::stod("nan");

 private:
  std::string prefix_, name_;
};
using CommandInterface = Handle;
class Loaned {
 public:
  explicit Loaned(Handle::SharedPtr handle) : handle_(handle) {}
  Loaned(const Loaned&) = delete;
  Loaned(Loaned&&) = default;
  const std::string& get_name() const { return handle_->get_name(); }
  template <class T = double> [[nodiscard]] std::optional<T> get_optional(unsigned = 10) const {
    return handle_->get_optional<T>();
  }
  template <class T> [[nodiscard]] bool set_value(const T& value, unsigned = 10) {
    return handle_->set_value(value);
  }

 private:
  Handle::SharedPtr handle_;
};
}
namespace controller_interface {
enum class CallbackReturn : std::uint8_t { SUCCESS = 97, FAILURE = 98, ERROR = 99 };
enum class return_type : std::uint8_t { OK = 0, ERROR = 1 };
enum class interface_configuration_type : std::uint8_t { ALL = 0, INDIVIDUAL = 1, NONE = 2 };
struct InterfaceConfiguration {
  interface_configuration_type type = interface_configuration_type::NONE;
  std::vector<std::string> names = {};
};
class ChainableControllerInterface {
 public:
  virtual ~ChainableControllerInterface() = default;
  virtual CallbackReturn on_init() = 0;
  virtual CallbackReturn on_configure(const rclcpp_lifecycle::State&) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_activate(const rclcpp_lifecycle::State&) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_deactivate(const rclcpp_lifecycle::State&) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_cleanup(const rclcpp_lifecycle::State&) { return CallbackReturn::SUCCESS; }
  virtual InterfaceConfiguration command_interface_configuration() const = 0;
  virtual InterfaceConfiguration state_interface_configuration() const = 0;
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> get_node() { return node_; }
  std::shared_ptr<const rclcpp_lifecycle::LifecycleNode> get_node() const { return node_; }
  template <class T> T auto_declare(const std::string& name, const T& fallback) {
    const auto given = node_->given.find(name);
    return given == node_->given.end() ? fallback
                                       : rclcpp::Parameter(name, given->second).get_value<T>();
  }
  return_type update(const rclcpp::Time& time, const rclcpp::Duration& period) {
    if (!chained) {
      const return_type found = update_reference_from_subscribers(time, period);
      if (found != return_type::OK) return found;
    }
    return update_and_write_commands(time, period);
  }
  // What the manager does: claim the interfaces by the names that are asked for.
  std::vector<hardware_interface::Handle::SharedPtr> export_reference_interfaces() {
    ordered_exported_reference_interfaces_ = on_export_reference_interfaces_list();
    for (const auto& made : ordered_exported_reference_interfaces_)
      if (made->get_prefix_name().find(get_node()->get_name()) != 0)
        throw std::runtime_error(made->get_name());
    return ordered_exported_reference_interfaces_;
  }
  void assign_interfaces(std::vector<hardware_interface::Loaned>&& commands,
                         std::vector<hardware_interface::Loaned>&& states) {
    command_interfaces_ = std::move(commands);
    state_interfaces_ = std::move(states);
  }
  bool chained = false;

 protected:
  virtual std::vector<hardware_interface::CommandInterface::SharedPtr>
  on_export_reference_interfaces_list() = 0;
  virtual return_type update_reference_from_subscribers(const rclcpp::Time&, const rclcpp::Duration&) = 0;
  virtual return_type update_and_write_commands(const rclcpp::Time&, const rclcpp::Duration&) = 0;
  std::vector<hardware_interface::Loaned> command_interfaces_, state_interfaces_;
  std::vector<hardware_interface::CommandInterface::SharedPtr> ordered_exported_reference_interfaces_;

 private:
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> node_ = std::make_shared<rclcpp_lifecycle::LifecycleNode>();
};
}
