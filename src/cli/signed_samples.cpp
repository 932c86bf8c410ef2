#include "signed_samples.hpp"

#include <algorithm>
#include <cmath>

namespace servosense::cli {
namespace {

// For so long a drive brakes before a current without a sign is spoken of.
constexpr double kBraked_s = 0.1;
// Of the greatest effort: less may be noise about nothing.
constexpr double kOfGreatest = 0.05;

}  // namespace

SignedSamples::SignedSamples(SampleSource& source, const MachineFile& machine,
                             const StackPlan& plan)
    : source_(&source), period_s_(source.sample_period_s()) {
  for (const Channel channel : kDriveChannels) {
    const HostDriveSlotConfig* slot = plan.slot_of(channel);
    if (slot == nullptr) continue;
    const std::string section(section_of(channel));
    const auto stated = machine.flag(section, "current_is_unsigned");
    const std::optional<PowerReading>& power = source.drive(channel)->power;
    const bool current = slot->observer.drive.effort_per_ampere > 0;
    if (stated ? !*stated : !current && !power) continue;
    Drive drive{channel,
                stated.has_value(),
                {},
                EffortSign(effort_sign_config(
                    slot->observer.drive, period_s_,
                    slot->input.kind == MotionKind::counts ? slot->input.unit_per_count : 0)),
                slot->input.effort_per_unit,
                0,
                0,
                {},
                power,
                DriveSpeed(period_s_, true),
                {}};
    drive.input.configure(slot->input);
    drives_.push_back(std::move(drive));
  }
  answered_.assign(drives_.size(), 0);
}

bool SignedSamples::resolves() const {
  return std::any_of(drives_.begin(), drives_.end(), [](const Drive& d) { return d.resolved; });
}

void SignedSamples::answer(Drive& drive) {
  const auto d = static_cast<std::size_t>(&drive - drives_.data());
  while (const auto answer = drive.sign.pop()) {
    if (!drive.resolved) {
      const double magnitude = drive.magnitudes.front();
      drive.magnitudes.pop_front();
      if (answer->sign < 0 && answer->sure && magnitude > 0) drive.negative_s += period_s_;
      continue;
    }
    RawDriveSample<double>& raw = waiting_[answered_[d]++].sample.drive(drive.channel);
    const double along = answer->sign * (drive.effort_per_unit < 0 ? -1 : 1);
    raw.effort = along * std::abs(raw.effort);
    if (!drive.power) continue;
    raw.effort = drive.power->with_losses_Nm(raw.effort, drive.speeds.front());
    drive.speeds.pop_front();
  }
}

void SignedSamples::hear(const MachineServoSample& sample) {
  for (std::size_t d = 0; d < drives_.size();) {
    Drive& drive = drives_[d];
    const RawDriveSample<double>& raw = sample.drive(drive.channel);
    const DriveSample<double> now = drive.input.process(raw);
    const double speed = drive.speed.process(now.increment / period_s_);
    // An absolute power over the speed is along the motion, where that is no creeping.
    const bool negative =
        !drive.power ? raw.effort < 0
                     : std::abs(speed) > drive.power->known_from_rad_s && raw.effort * speed < 0;
    if (!drive.resolved && negative) {  // it has a sign
      drives_.erase(drives_.begin() + static_cast<std::ptrdiff_t>(d));
      answered_.erase(answered_.begin() + static_cast<std::ptrdiff_t>(d));
      continue;
    }
    const double magnitude = std::abs(now.effort);
    drive.greatest = std::max(drive.greatest, magnitude);
    drive.sign.push(now.increment, magnitude);
    if (drive.resolved && drive.power) drive.speeds.push_back(speed);
    if (!drive.resolved)
      drive.magnitudes.push_back(magnitude > kOfGreatest * drive.greatest ? magnitude : 0);
    answer(drive);
    ++d;
  }
}

Expected<bool> SignedSamples::next(MachineServoSample& sample) {
  const bool late = resolves();
  if (!late) {
    auto more = source_->next(sample);
    if (!more || !*more) return more;
    recorded_ = source_->recorded();
    hear(sample);
    return true;
  }
  const auto ready = [&] {
    if (waiting_.empty()) return false;
    if (ended_) return true;
    for (std::size_t d = 0; d < drives_.size(); ++d)
      if (drives_[d].resolved && answered_[d] == 0) return false;
    return true;
  };
  while (!ready()) {
    if (ended_) return false;
    MachineServoSample newest;
    auto more = source_->next(newest);
    if (!more) return more;
    if (!*more) {
      ended_ = true;
      for (Drive& drive : drives_) {
        drive.sign.finish();
        answer(drive);
      }
      continue;
    }
    waiting_.push_back({newest, source_->recorded()});
    hear(newest);
  }
  sample = waiting_.front().sample;
  recorded_ = waiting_.front().recorded;
  waiting_.pop_front();
  for (std::size_t& n : answered_)
    if (n > 0) --n;
  return true;
}

std::vector<std::string> SignedSamples::remarks() const {
  std::vector<std::string> all;
  for (const Drive& drive : drives_) {
    if (drive.resolved)
      all.push_back(signs_found(drive.channel, drive.sign.sure_share()));
    else if (drive.negative_s > kBraked_s)
      all.push_back(signs_wanted(drive.channel));
  }
  return all;
}

}  // namespace servosense::cli
