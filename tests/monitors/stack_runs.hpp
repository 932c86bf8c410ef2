// Runs of a stack that hears each sample, or groups of them: a steady cut, and every fault on every
// drive at several places of the motion, flagged at once, noticed by nobody else and over in time.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "check.hpp"
#include "four_drives.hpp"

namespace four_drives {

/// The estimates against what was put in, once settled. Returns the samples that the stack counted.
template <typename Real>
std::uint64_t steady_cut(const MonitorStackConfig& config,
                         const std::array<double, kDrives>& bound) {
  auto stack = std::make_unique<Stack<Real>>();
  CHECK(Stack<Real>::validate(config).ok());
  stack->configure(config);
  Mirror<Real> mirror;
  std::array<double, kDrives> worst{};
  int n = 0;
  for (const ServoSample<Real>& s : recording<Real>(16'000)) {
    mirror.follow(stack->process(s), *stack);
    if (++n > 2 * kSettled)
      for (std::size_t d = 0; d < kDrives; ++d)
        worst[d] =
            std::max(worst[d], std::abs(static_cast<double>(out(*stack, d).estimate) - truth(d)));
  }
  for (std::size_t d = 0; d < kDrives; ++d) {
    check::figure(std::string(kNames[d]) + ", " + precision<Real>() + ": off by at most", worst[d],
                  d == 0 ? "Nm" : "N");
    CHECK_BETWEEN(worst[d], 0.0, bound[d]);
    CHECK(out(*stack, d).state == MonitorState::armed);
  }
  CHECK(mirror.ok && mirror.alarms == 0 && mirror.warnings == 0);
  CHECK(mirror.changes == 2 * kDrives);  // learning, armed
  return stack->samples();
}

struct FaultRuns {
  MonitorStackConfig config;
  std::array<int, 5> starts;              ///< samples
  std::array<int, kDrives> group;         ///< samples that a drive's monitor hears as one
  std::array<double, kDrives> bound;      ///< of the estimate, once right again [Nm, N]
  int settled = 0;                        ///< samples after which no flag may be left
  int spindle_armed = 0, axis_armed = 0;  ///< samples after which the monitor watches again
};

template <typename Real>
bool same_bits(Real a, Real b) {
  using Bytes = std::array<std::byte, sizeof(Real)>;
  return std::bit_cast<Bytes>(a) == std::bit_cast<Bytes>(b);
}

template <typename Real>
void faults(const FaultRuns& runs) {
  constexpr int kSamples = 10000;
  const auto clean = recording<Real>(kSamples);
  std::vector<std::array<Real, kDrives>> reference;
  auto stack = std::make_unique<Stack<Real>>();
  stack->configure(runs.config);
  for (const auto& s : clean) {
    stack->process(s);
    auto& row = reference.emplace_back();
    for (std::size_t d = 0; d < kDrives; ++d) row[d] = out(*stack, d).estimate;
  }
  for (std::size_t d = 0; d < kDrives; ++d)
    for (const Fault& f : all_faults())
      for (const int start : runs.starts) {
        stack->configure(runs.config);
        Mirror<Real> mirror;
        bool flagged = true, others = true, finite = true, right = true;
        bool stands_down = false;
        int good_again = 0;
        double off = 0;
        const int end = start + f.length;
        // After a restart at standstill nobody knows which way friction points until the axis
        // moves.
        const int known = f.length > 8 ? moved_on(d, end) : end;
        for (int n = 0; n < kSamples; ++n) {
          ServoSample<Real> s = clean[static_cast<std::size_t>(n)];
          const bool faulty = n >= start && n < end;
          if (faulty) spoil(raw(s, d), f);
          mirror.follow(stack->process(s), *stack);
          const auto& drive = out(*stack, d);
          const auto& was = reference[static_cast<std::size_t>(n)];
          const bool down = drive.state == MonitorState::signal_fault;
          // Said with the very sample by the estimate. A monitor steps over a single one.
          if (faulty) {
            flagged = flagged && has(drive.quality, kUnusable | Quality::gap);
          }
          stands_down = stands_down || down;
          for (std::size_t k = 0; k < kDrives; ++k) {
            finite = finite && std::isfinite(out(*stack, k).estimate);
            if (k != d) others = others && same_bits(out(*stack, k).estimate, was[k]);
          }
          if (n >= end && drive.state != MonitorState::armed) good_again = n + 1 - end;
          if (n >= known + kSettled)
            off = std::max(off, std::abs(static_cast<double>(drive.estimate) - truth(d)));
          if (n >= end + runs.settled)
            right = right && !has(drive.quality, kUnusable | Quality::gap | Quality::settling);
        }
        const auto that = [&](bool ok, const std::string& what) {
          check::that(ok,
                      (std::string(kNames[d]) + ", " + precision<Real>() + ", " + f.name + " at " +
                       std::to_string(start) + ": " + what)
                          .c_str(),
                      __FILE__, __LINE__);
        };
        that(flagged, "flagged with the sample");
        if (f.length == 1) that(!stands_down, "goes on watching");
        if (f.length >= 200) that(stands_down, "the monitor stands down");
        that(finite, "finite");
        that(others, "the other drives do not notice");
        that(right, "good again when the filters have settled");
        that(off <= runs.bound[d], "right again, off by " + std::to_string(off));
        // What has stood down is told to be armed half a second later at the earliest.
        const int told = static_cast<int>(0.5 / kPeriod_s) + 1;
        that(good_again <= told + (d == 0 ? runs.spindle_armed : runs.axis_armed),
             "armed again, after " + std::to_string(good_again));
        that(mirror.ok, "each change is reported once");
        that(mirror.alarms == 0 && mirror.warnings == 0, "no alarm and no warning");
      }
}

}  // namespace four_drives
