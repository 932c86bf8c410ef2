// Programs cut into stock, for the tests of workpiece and engagement.
#pragma once

#include <cmath>
#include <cstdlib>
#include <numbers>
#include <string>
#include <vector>

#include "check.hpp"
#include "servosense/process/engagement/program_engagement.hpp"
#include "servosense/process/program/program_reader.hpp"

namespace cut_parts {

using namespace servosense::process;

inline Cutter cutter_of(const CutterShape& shape) {
  auto cutter = Cutter::of(shape);
  if (!cutter) {
    check::fail(__FILE__, __LINE__) << cutter.error().sentence << '\n';
    std::exit(check::done());
  }
  return *cutter;
}

struct Cut {
  double removed_m3 = 0, error_m3 = 0, left_m3 = 0;
  std::vector<Engagement> steps;
  std::string error;
};

struct CutOptions {
  double spacing_m = kDefaultSpacing;
  double step_share = kStepShare;
};

/// Cuts `program` (millimetres, after G21 G90 G17). T0, in the spindle at first, is the first
/// cutter.
inline Cut cut(const Stock& stock, const std::vector<Cutter>& cutters, const std::string& program,
               const CutOptions& options = {}) {
  Cut result;
  auto workpiece = Workpiece::of(stock, options.spacing_m);
  if (!workpiece) {
    result.error = workpiece.error().sentence;
    return result;
  }
  ProgramEngagement engagement(
      *workpiece,
      [&](int tool) {
        return servosense::Expected<ProgramEngagement::Turning>(
            {&cutters.at(static_cast<std::size_t>(tool)), nullptr});
      },
      [&](const Engagement& e) { result.steps.push_back(e); }, options.step_share);
  std::string refused;
  const auto done =
      run_program(ProgramText::from("G21 G90 G17 G61 F1000\n" + program + "\nM2\n", "part.ngc"), {},
                  [&](const CanonicalMove& move) {
                    if (!refused.empty()) return;
                    if (const auto put = engagement.put(move); !put) refused = put.error().sentence;
                  });
  engagement.finish();
  result.error = !done ? done.error().sentence : refused;
  result.removed_m3 = engagement.removed_m3();
  result.error_m3 = engagement.removed_error_m3();
  result.left_m3 = workpiece->volume_m3();
  return result;
}

inline BoxStock box_mm(double x0, double y0, double z0, double x1, double y1, double z1) {
  return {{x0 * 1e-3, y0 * 1e-3, z0 * 1e-3}, {x1 * 1e-3, y1 * 1e-3, z1 * 1e-3}};
}

}  // namespace cut_parts
