#include "common_rows.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "servosense/io/text.hpp"

namespace servosense::cli {
namespace {
constexpr double kLateRow = 0.5;  // steps more than the usual one: a row is missing
}  // namespace

Expected<CommonRows> common_rows(const std::string& path, const Trace& trace,
                                 const FoundColumn& first, const FoundColumn& second,
                                 NoNumber no_number) {
  const std::string in = column_name(first.trace->signals[first.at]);
  const std::string out = column_name(second.trace->signals[second.at]);
  CommonRows r;
  std::vector<double> t_s;
  std::size_t of_first = 0, of_second = 0, begun_late = 0;
  for (std::size_t row = 0; row < trace.size(); ++row) {
    of_first += first.updated(row);
    of_second += second.updated(row);
    if (!first.updated(row) || !second.updated(row)) continue;
    // An estimate begins when its filters have.
    if (t_s.empty() && !(std::isfinite(first.value(row)) && std::isfinite(second.value(row)))) {
      ++begun_late;
      continue;
    }
    for (const auto& [column, value] :
         {std::pair{&in, first.value(row)}, std::pair{&out, second.value(row)}})
      if (no_number == NoNumber::refuse && !std::isfinite(value))
        return data_error(path + ": " + *column + " is no number at " + printed(trace.t_s[row], 6) +
                          " s; cut the trace there and give each piece as a trace of its own");
    t_s.push_back(trace.t_s[row]);
    r.first.push_back(first.value(row));
    r.second.push_back(second.value(row));
  }
  const std::size_t common = t_s.size() + begun_late;
  if (of_first != common || of_second != common)
    return data_error(path + ": " + in + " has " + std::to_string(of_first) + " values and " + out +
                      " has " + std::to_string(of_second) + ", " + std::to_string(common) +
                      " of them in common rows; record both at one rate");
  if (t_s.size() < 3) return data_error(path + ": fewer than three rows; record longer");
  r.begin_s = t_s.front();
  r.sample_rate_hz = static_cast<double>(t_s.size() - 1) / (t_s.back() - t_s.front());
  std::vector<double> steps;
  for (std::size_t i = 1; i < t_s.size(); ++i) steps.push_back(t_s[i] - t_s[i - 1]);
  std::nth_element(steps.begin(), steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2),
                   steps.end());
  const double usual = steps[steps.size() / 2];
  for (std::size_t i = 1; i < t_s.size(); ++i)
    if (std::abs(t_s[i] - t_s[i - 1] - usual) > kLateRow * usual)
      return data_error(path + ": a row is missing or late at " + printed(t_s[i], 6) +
                        " s; cut the trace there and give each piece as a trace of its own");
  return r;
}

}  // namespace servosense::cli
