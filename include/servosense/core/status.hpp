// Result of validating a configuration, fit for firmware: no heap, no exception.
#pragma once

namespace servosense {

/// Why a configuration was refused, in one sentence with static storage; ok() when it was not.
/// `parameter` names the offending field as it is spelled in the Config struct.
class [[nodiscard]] Status {
 public:
  constexpr Status() noexcept = default;
  static constexpr Status invalid(const char* parameter, const char* reason) noexcept {
    Status s;
    s.parameter_ = parameter;
    s.reason_ = reason;
    return s;
  }
  [[nodiscard]] constexpr bool ok() const noexcept { return reason_ == nullptr; }
  [[nodiscard]] constexpr const char* parameter() const noexcept { return parameter_; }
  [[nodiscard]] constexpr const char* reason() const noexcept { return ok() ? "" : reason_; }

 private:
  const char* parameter_ = "";
  const char* reason_ = nullptr;
};

}  // namespace servosense
