#include "monitor_outputs.hpp"

#include <cmath>
#include <cstdio>
#include <sstream>
#include <utility>

#include "servosense/io/json.hpp"
#include "servosense/observer/machine_config.hpp"

namespace servosense::cli {
namespace {

constexpr std::size_t kBlock = std::size_t{1} << 16U;
// Of events that wait for room: some thousands, more than a run keeps people busy with.
constexpr std::size_t kMostWaiting = std::size_t{1} << 20U;

}  // namespace

Expected<Done> EventSink::open(const std::optional<std::string>& path, bool live) {
  if (!path) return Done{};
  live_ = live;
  auto file = *path == "-" ? OutputFile::standard_output()
                           : OutputFile::open(
                                 *path, live ? OutputFile::Kind::growing : OutputFile::Kind::whole);
  if (!file) return file.error();
  file_ = std::move(*file);
  return Done{};
}

void EventSink::write(const Event& event) {
  if (file_) write_line(to_json_line(event));
}

void EventSink::write_command(double t_s, const char* phase, double speed_ratio, double feed_ratio,
                              bool hold, const std::string& reason) {
  if (!file_) return;
  std::ostringstream out;
  JsonWriter json(out);
  json.begin_object();
  json.member("t_s", t_s);
  json.member("phase", phase);
  json.member("speed_ratio", speed_ratio);
  json.member("feed_ratio", feed_ratio);
  json.member("hold", hold);
  json.member("reason", reason);
  json.end_object();
  write_line(out.str());
}

void EventSink::write_line(const std::string& line) {
  if (waiting_.size() > kMostWaiting) {
    ++lost_;
  } else {
    waiting_ += line + '\n';
    ++lines_;
  }
  if (live_ || waiting_.size() >= kBlock) flush();
}

void EventSink::flush() {
  auto done = file_->write(waiting_);
  if (!done) {
    if (!failure_) failure_ = done.error();
    return;
  }
  waiting_.clear();
  lines_ = 0;
}

Expected<Done> EventSink::close() {
  if (!file_) return Done{};
  flush();
  const auto placed = file_->commit();
  file_.reset();
  if (!placed && !failure_) failure_ = placed.error();
  if (const std::uint64_t missing = lines_ + lost_; missing > 0)
    return device_error(failure_->sentence + "; " + std::to_string(missing) +
                        " line(s) are missing there");
  if (!placed) return placed.error();
  return Done{};
}

Expected<Done> EstimateSink::open(const std::optional<std::string>& path,
                                  const MachineFile& machine, const StackPlan& plan,
                                  const std::string& trace, bool live) {
  if (!path) return Done{};
  std::vector<Signal> signals;
  std::string without;
  for (const Channel channel : kDriveChannels) {
    const HostDriveSlotConfig* slot = plan.slot_of(channel);
    if (slot == nullptr) continue;
    const double noise = estimate_noise(machine, channel, slot->observer.disturbance_cutoff_rad_s);
    if (!(noise > 0)) without += (without.empty() ? "" : ", ") + std::string(name_of(channel));
    Drive& drive = drives_.emplace_back();
    drive.channel = channel;
    drive.band.configure(estimate_band_of(
        slot->observer, noise, std::abs(slot->input.unit_per_count), is_turning(channel)));
    signals.push_back({channel, is_turning(channel) ? Quantity::torque_Nm : Quantity::force_N});
  }
  for (const Drive& drive : drives_)
    signals.push_back({drive.channel, is_turning(drive.channel) ? Quantity::torque_band_Nm
                                                                : Quantity::force_band_N});
  TraceMetadata about = {{"content", "cutting torque and force estimated by servosense"},
                         {"trace", trace},
                         {"band", "the truth lies within the estimate +- the band" +
                                      (without.empty() ? ""
                                                       : ", noise left out, which the machine file "
                                                         "does not say of " +
                                                             without)}};
  auto writer = TraceWriter::create(*path, signals, about,
                                    live ? OutputFile::Kind::growing : OutputFile::Kind::whole);
  if (!writer) return writer.error();
  writer_ = std::make_unique<TraceWriter>(std::move(*writer));
  values_.resize(signals.size());
  return Done{};
}

void EstimateSink::write(Nanoseconds t_ns, const MachineStack& stack, const KnownTorque& torque) {
  if (!writer_) return;
  for (std::size_t i = 0; i < drives_.size(); ++i) {
    Drive& d = drives_[i];
    const HostStack::Drive& drive = stack.drive(d.channel);
    const bool known = !has(drive.quality, Quality::gap) && torque.known(d.channel);
    values_[i] = known ? drive.estimate : std::nan("");
    // In groups, the motion of the last sample of one is that of all; the position goes on.
    const double band = d.band.process(drive.sample.position - d.position, drive.quality);
    d.position = drive.sample.position;
    values_[drives_.size() + i] = known ? band : std::nan("");
  }
  static_cast<void>(writer_->write(t_ns, values_));
}

void OutputWatch::look() {
  for (Output& output : outputs_)
    if (!output.said && output.failure->has_value()) {
      output.said = true;
      std::fprintf(stderr, "servosense: %s; the run goes on without it\n",
                   (*output.failure)->sentence.c_str());
    }
}

}  // namespace servosense::cli
