#include "servosense/process/verification/remainder.hpp"

#include <algorithm>
#include <vector>

#include "servosense/io/text.hpp"
#include "servosense/process/verification/program_check.hpp"

namespace servosense::process {

Remainder remainder_of(const Workpiece& workpiece, const Workpiece& target, double tolerance_m) {
  Remainder found;
  const Dexels &lines = workpiece.lines(2), &wanted = target.lines(2);
  const Point& origin = workpiece.origin();
  const auto plan = workpiece.plan();
  const double lower = target.origin()[2] - origin[2];
  std::vector<std::array<double, 2>> covered;
  for (std::size_t j = 0; j < plan[1]; ++j)
    for (std::size_t i = 0; i < plan[0]; ++i) {
      const auto stretches = lines.of(workpiece.column(i, j));
      if (stretches.empty()) continue;
      const double x = workpiece.column_x(i, j), y = workpiece.column_y(i, j);
      covered.clear();
      const auto is = target.plan_range(0, {x - tolerance_m, x + tolerance_m});
      const auto js = target.plan_range(1, {y - tolerance_m, y + tolerance_m});
      // One more all round: the line of a cell stands anywhere in it.
      for (std::size_t tj = js[0] - (js[0] > 0 ? 1 : 0); tj < std::min(js[1] + 1, target.plan()[1]);
           ++tj)
        for (std::size_t ti = is[0] - (is[0] > 0 ? 1 : 0);
             ti < std::min(is[1] + 1, target.plan()[0]); ++ti)
          for (const Stretch& s : wanted.of(target.column(ti, tj)))
            covered.push_back({static_cast<double>(s.low) + lower - tolerance_m,
                               static_cast<double>(s.high) + lower + tolerance_m});
      std::ranges::sort(covered);
      for (const Stretch& s : stretches) {
        double low = static_cast<double>(s.low);
        const double high = static_cast<double>(s.high);
        const auto leave = [&](double to) {
          if (!(to > low)) return;
          found.volume_m3 += (to - low) * workpiece.plan_area_m2();
          if (to - low <= found.greatest_height_m) return;
          found.greatest_height_m = to - low;
          found.at = {x, y, origin[2] + (low + to) / 2};
        };
        for (const auto& [from, to] : covered) {
          if (to <= low) continue;
          if (from >= high) break;
          leave(std::min(from, high));
          low = std::max(low, to);
        }
        leave(high);
      }
    }
  return found;
}

std::optional<Finding> finding_of(const Remainder& remainder, double tolerance_m) {
  if (!(remainder.volume_m3 > kLeastContact)) return {};
  Finding finding;
  finding.kind = FindingKind::uncut_remainder;
  finding.position = remainder.at;
  finding.size = remainder.volume_m3;
  finding.message = printed(remainder.volume_m3 * 1e9) + " mm3 are left on the target, up to " +
                    printed(remainder.greatest_height_m * 1e3) + " mm high, by more than " +
                    printed(tolerance_m * 1e3) + " mm; cut there, or give a target that has it";
  return finding;
}

}  // namespace servosense::process
