#include "stop_sink.hpp"

#include <cstdio>
#include <utility>

#include "servosense/hal/linuxcnc_link.hpp"
#include "servosense/hal/simulated_cnc.hpp"

namespace servosense::cli {
namespace {

constexpr const char* kSimulated = "simulated";

}  // namespace

Expected<Done> StopSink::check(const Arguments& arguments) {
  const auto level = arguments.value("--stop-on");
  const auto cnc = arguments.value("--cnc");
  if (level && *level != "alarm" && *level != "warning")
    return usage_error("--stop-on takes 'alarm' or 'warning'");
  if (level && !cnc)
    return usage_error("--stop-on needs the CNC that is to stop; add --cnc linuxcnc://HOST:5007");
  if (arguments.has("--commands") && !cnc)
    return usage_error(
        "--commands writes what a CNC is told; add --cnc linuxcnc://HOST:5007, or simulated");
  if (!cnc || *cnc == kSimulated) return Done{};
  if (const auto config = linuxcnc_config(*cnc); !config) return config.error();
  if (!arguments.has("--can") && !arguments.has("--modbus"))
    return usage_error(
        "a replay must not stop a machine; use --cnc simulated, or a live source (--can, "
        "--modbus)");
  return Done{};
}

Expected<Done> StopSink::open(const Arguments& arguments, bool overrides) {
  const auto cnc = arguments.value("--cnc");
  if (!cnc) return Done{};
  if (*cnc == kSimulated) {
    SimulatedCncConfig config;
    config.real_time = true;
    link_ = std::make_unique<SimulatedCnc>(config);
  } else {
    const auto config = linuxcnc_config(*cnc);
    if (!config) return config.error();
    link_ = std::make_unique<LinuxCncLink>(*config);
  }
  // Better to know now than when it is wanted.
  const CncReply reply = link_->connect();
  if (reply != CncReply::done)
    return device_error(link_->name() +
                        (reply == CncReply::refused
                             ? " refuses control; check its passwords"
                             : " does not answer; check the address, and that it is running"));
  if (arguments.value("--stop-on") == "warning") level_ = MonitorState::warning;
  StopRequest::Beside beside;
  if (overrides) {
    overrides_ = std::make_unique<OverrideRequest>(*link_);
    beside = [this] { return overrides_->turn(); };
  }
  request_ = std::make_unique<StopRequest>(
      *link_, StopRequestConfig{},
      [](const std::string& what) { std::fprintf(stderr, "servosense: %s\n", what.c_str()); },
      std::move(beside));
  request_->start();
  return Done{};
}

std::optional<StopHealth> StopSink::close() {
  if (!request_) return std::nullopt;
  request_->stop();
  if (overrides_ && !overrides_->give_back())
    std::fprintf(stderr,
                 "servosense: %s was not seen to take its overrides back; set them by hand\n",
                 link_->name().c_str());
  return request_->health();
}

std::string stop_summary(const StopHealth& h) {
  if (h.events == 0) return "feed hold: not asked for";
  char text[280];
  std::snprintf(text, sizeof text,
                "feed hold: asked for %llu time(s), acknowledged %llu time(s), seen to stand %llu "
                "time(s); acknowledged in the median %.3g ms and at most %.3g ms after the "
                "sample's arrival, %llu tries",
                static_cast<unsigned long long>(h.events), static_cast<unsigned long long>(h.held),
                static_cast<unsigned long long>(h.seen),
                1e-6 * static_cast<double>(h.reaction.quantile_ns(0.5)),
                1e-6 * static_cast<double>(h.reaction.greatest_ns()),
                static_cast<unsigned long long>(h.tries));
  return text;
}

}  // namespace servosense::cli
