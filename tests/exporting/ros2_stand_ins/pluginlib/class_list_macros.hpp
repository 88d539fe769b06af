// In place of the registration by name, a function that makes the plug-in.
#pragma once
#include <memory>
#define PLUGINLIB_EXPORT_CLASS(made, base) \
  std::unique_ptr<base> make_plugin() { return std::make_unique<made>(); }
