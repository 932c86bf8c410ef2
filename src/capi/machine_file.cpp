#include "servosense/capi/machine_file.h"

#include <algorithm>
#include <exception>
#include <string>

#include "servosense/capi/machine_config.hpp"

namespace {

using namespace servosense;

Expected<MachineConfig> config_from(const char* path, const servosense_signals& reported) {
  auto machine = MachineFile::read(path);
  if (!machine) return machine.error();
  StackSignals signals;
  signals.sample_period_s = reported.sample_period_s;
  for (int i = 0; i <= SERVOSENSE_AXES; ++i) {
    if (reported.motion[i] < 0) continue;
    if (reported.motion[i] > SERVOSENSE_VELOCITY)
      return usage_error("a drive's motion must be counts, position or velocity");
    const DriveSignal signal{static_cast<MotionKind>(reported.motion[i]),
                             reported.current[i] != 0              ? EffortKind::current_A
                             : is_turning(static_cast<Channel>(i)) ? EffortKind::torque_Nm
                                                                   : EffortKind::force_N};
    if (i == 0)
      signals.spindle = signal;
    else
      signals.axis[static_cast<std::size_t>(i - 1)] = signal;
  }
  return machine_config(*machine, signals);
}

void copy(const std::string& sentence, char* error, size_t bytes) {
  if (error == nullptr || bytes == 0) return;
  const size_t n = std::min(sentence.size(), bytes - 1);
  sentence.copy(error, n);
  error[n] = '\0';
}

template <typename T>
const T* kept(const std::vector<T>& values) {
  if (values.empty()) return nullptr;
  T* const own = new T[values.size()];
  std::copy(values.begin(), values.end(), own);
  return own;
}

template <typename T>
void give_back(const T*& values) {
  delete[] values;
  values = nullptr;
}

}  // namespace

extern "C" int servosense_config_from_file(const char* path, const servosense_signals* signals,
                                           servosense_config* config, char* error,
                                           size_t error_bytes) {
  if (path == nullptr || signals == nullptr || config == nullptr) {
    copy("path, signals and configuration must be given", error, error_bytes);
    return -1;
  }
  try {
    auto filled = config_from(path, *signals);
    if (!filled) {
      copy(filled.error().sentence, error, error_bytes);
      return -1;
    }
    *config = filled->config;
    config->spindle.effects = kept(filled->effects[0]);
    for (std::size_t i = 0; i < SERVOSENSE_AXES; ++i)
      config->axis[i].effects = kept(filled->effects[1 + i]);
    config->torque_band.reference = kept(filled->reference);
    config->torque_band.sections = kept(filled->sections);
    return 0;
  } catch (const std::exception& e) {  // out of memory: nothing may cross the line
    copy(e.what(), error, error_bytes);
    return -1;
  }
}

extern "C" void servosense_free_config(servosense_config* config) {
  if (config == nullptr) return;
  give_back(config->spindle.effects);
  for (servosense_drive& axis : config->axis) give_back(axis.effects);
  give_back(config->torque_band.reference);
  give_back(config->torque_band.sections);
}
