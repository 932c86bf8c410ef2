// What was identified, with its standard error, as it is printed and written.
#pragma once

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "console.hpp"
#include "servosense/identify/idle.hpp"
#include "servosense/io/json.hpp"

namespace servosense::cli {

/// The comment of a key.
[[nodiscard]] inline std::string plus_minus(const Estimate& e) {
  if (std::isnan(e.standard_error)) return "as before";
  char text[64];
  std::snprintf(text, sizeof text, "+- %.3g (standard error)", e.standard_error);
  return text;
}

/// To what a reader wants to see.
[[nodiscard]] inline double rounded(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.8g", value);
  return std::strtod(text, nullptr);
}

inline void print_row(const char* what, const Estimate& e, const std::string& unit) {
  say("  %-22s %12.6g +- %-10.3g %s\n", what, e.value, e.standard_error, unit.c_str());
}

inline void write_estimate(JsonWriter& json, const char* key, const Estimate& e) {
  json.key(key);
  json.begin_object();
  json.member("value", e.value);
  json.member("standard_error", e.standard_error);
  json.end_object();
}

}  // namespace servosense::cli
