// Drives the controller of a package as ros2_control's manager does, by lines of the input:
//   NAME TYPE VALUES  a parameter, before `start` as of a file, later as set by a user
//   start             init, configure, claim; prints the names of the interfaces
//   activate, stop    with the measured positions of the last cycle, or 0
//   chained           references come from another controller
//   states NUMBERS, references NUMBERS, cycle     prints what update returns and the efforts
#include CONTROLLER

#include <iostream>
#include <sstream>

namespace {

using Handles = std::vector<hardware_interface::Handle::SharedPtr>;
using Callback = controller_interface::CallbackReturn;

rclcpp::Value value(std::istringstream& line) {
  std::string type, word;
  line >> type;
  std::vector<std::string> words;
  while (line >> word) words.push_back(word);
  if (type == "bool") return words.at(0) == "true";
  if (type == "string") return words.empty() ? std::string() : words[0];
  if (type == "strings") return words;
  std::vector<double> numbers;
  for (const std::string& text : words) numbers.push_back(std::stod(text));
  return numbers;
}

void fill(const Handles& handles, std::istringstream& line) {
  std::string word;
  for (const auto& handle : handles)
    if (line >> word) handle->value = std::stod(word);
}

Handles claimed(const controller_interface::InterfaceConfiguration& asked) {
  Handles made;
  for (const std::string& name : asked.names) {
    const auto cut = name.rfind('/');
    made.push_back(std::make_shared<hardware_interface::Handle>(name.substr(0, cut), name.substr(cut + 1)));
    std::cout << name << " ";
  }
  return made;
}

std::vector<hardware_interface::Loaned> loaned(const Handles& handles) {
  std::vector<hardware_interface::Loaned> made;
  for (const auto& handle : handles) made.emplace_back(handle);
  return made;
}

}  // namespace

int main() {
  auto controller = make_plugin();
  auto node = controller->get_node();
  node->name = "friction";
  Handles commands, states, references;
  bool started = false;
  for (std::string text; std::getline(std::cin, text);) {
    std::istringstream line(text);
    std::string word;
    line >> word;
    if (word == "start") {
      started = controller->on_init() == Callback::SUCCESS && controller->on_configure({}) == Callback::SUCCESS;
      if (!started) return 1;
      commands = claimed(controller->command_interface_configuration());
      states = claimed(controller->state_interface_configuration());
      controller->assign_interfaces(loaned(commands), loaned(states));
      references = controller->export_reference_interfaces();
      for (const auto& reference : references) std::cout << reference->get_name() << " ";
      std::cout << "\n";
    } else if (word == "activate") {
      std::cout << (controller->on_activate({}) == Callback::SUCCESS ? "active" : "refused") << "\n";
    } else if (word == "stop") {
      if (controller->on_deactivate({}) != Callback::SUCCESS) return 1;
      for (const auto& command : commands) std::cout << command->value << " ";
      std::cout << "\n";
    } else if (word == "chained") {
      controller->chained = true;
    } else if (word == "states" || word == "references") {
      fill(word == "states" ? states : references, line);
    } else if (word == "cycle") {
      const auto found = controller->update({}, {});
      std::cout.precision(17);
      std::cout << static_cast<int>(found) << " ";
      for (const auto& command : commands) std::cout << command->value << " ";
      std::cout << "\n";
    } else if (!started) {
      node->given[word] = value(line);
    } else {
      const auto found = node->changes.lock()->callback({rclcpp::Parameter(word, value(line))});
      std::cout << (found.successful ? "taken" : "refused: " + found.reason) << "\n";
    }
    std::cout.flush();
  }
}
