// A value or an error sentence, for offline code (readers, identification, the command line).
// Stands in for C++23's std::expected and keeps its spelling.
#pragma once

#include <cassert>
#include <string>
#include <utility>
#include <variant>

namespace servosense {

/// What went wrong, so that the command line can answer with the right exit status.
enum class ErrorKind {
  usage,   ///< the caller asked for something that makes no sense (exit status 2)
  data,    ///< the input is malformed or does not hold what is needed (exit status 3)
  device,  ///< a file or device could not be opened, read or written (exit status 4)
};

/// One sentence a machinist understands: what, where, what to do.
struct Error {
  ErrorKind kind = ErrorKind::data;
  std::string sentence;
};

inline Error usage_error(std::string sentence) { return {ErrorKind::usage, std::move(sentence)}; }
inline Error data_error(std::string sentence) { return {ErrorKind::data, std::move(sentence)}; }
inline Error device_error(std::string sentence) { return {ErrorKind::device, std::move(sentence)}; }

/// Either a value or an Error. Look before you dereference: `if (!result) return result.error();`
template <typename T>
class [[nodiscard]] Expected {
 public:
  Expected(T value) : content_(std::move(value)) {}      // NOLINT(google-explicit-constructor)
  Expected(Error error) : content_(std::move(error)) {}  // NOLINT(google-explicit-constructor)

  [[nodiscard]] bool has_value() const { return content_.index() == 0; }
  explicit operator bool() const { return has_value(); }

  T& value() & {
    assert(has_value());
    return *std::get_if<0>(&content_);
  }
  const T& value() const& {
    assert(has_value());
    return *std::get_if<0>(&content_);
  }
  T&& value() && {
    assert(has_value());
    return std::move(*std::get_if<0>(&content_));
  }
  T& operator*() & { return value(); }
  const T& operator*() const& { return value(); }
  T&& operator*() && { return std::move(*this).value(); }
  T* operator->() { return &value(); }
  const T* operator->() const { return &value(); }

  [[nodiscard]] const Error& error() const {
    assert(!has_value());
    return *std::get_if<1>(&content_);
  }

 private:
  std::variant<T, Error> content_;
};

/// Success without a value.
struct Done {};

}  // namespace servosense
