// As much of rclcpp as the controller uses: parameters and errors in the log, which are printed.
#pragma once
#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <variant>
#include <vector>

#define RCLCPP_ERROR(logger, ...) ((void)(logger), std::printf("error "), std::printf(__VA_ARGS__), std::puts(""))

namespace rcl_interfaces::msg {
struct SetParametersResult {
  bool successful = false;
  std::string reason;
};
}
namespace rclcpp {
struct Logger {};
struct Time {};
struct Duration {};
using Value = std::variant<bool, std::string, std::vector<std::string>, std::vector<double>>;
class Parameter {
 public:
  Parameter(std::string name, Value value) : name_(std::move(name)), value_(std::move(value)) {}
  const std::string& get_name() const { return name_; }
  template <class T> T get_value() const {
    if (!std::holds_alternative<T>(value_)) throw std::runtime_error(name_ + ": has another type");
    return std::get<T>(value_);
  }
  bool as_bool() const { return get_value<bool>(); }
  std::string as_string() const { return get_value<std::string>(); }
  std::vector<std::string> as_string_array() const { return get_value<std::vector<std::string>>(); }
  std::vector<double> as_double_array() const { return get_value<std::vector<double>>(); }

 private:
  std::string name_;
  Value value_;
};
namespace node_interfaces {
struct OnSetParametersCallbackHandle {
  using SharedPtr = std::shared_ptr<OnSetParametersCallbackHandle>;
  std::function<rcl_interfaces::msg::SetParametersResult(const std::vector<Parameter>&)> callback;
};
}
}
namespace rclcpp_lifecycle {
struct State {};
struct LifecycleNode {
  std::string name;
  std::map<std::string, rclcpp::Value> given;
  std::weak_ptr<rclcpp::node_interfaces::OnSetParametersCallbackHandle> changes;
  const char* get_name() const { return name.c_str(); }
  rclcpp::Logger get_logger() const { return {}; }
  auto add_on_set_parameters_callback(
      std::function<rcl_interfaces::msg::SetParametersResult(const std::vector<rclcpp::Parameter>&)> f) {
    auto handle = std::make_shared<rclcpp::node_interfaces::OnSetParametersCallbackHandle>();
    handle->callback = f;
    changes = handle;
    return handle;
  }
};
}
