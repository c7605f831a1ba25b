// A stub of the vendor's library, written from the names of its API; not the vendor's.
#pragma once

#include <memory>
#include <string>

namespace Ultraleap {
namespace Haptics {

class Error {
 public:
  explicit Error(std::string text) : text_(std::move(text)) {}
  const char* message() const { return text_.c_str(); }

 private:
  std::string text_;
};

template <class Value>
class [[nodiscard]] result {
 public:
  result(Value value) : value_(std::make_shared<Value>(std::move(value))) {}
  result(Error error) : error_(std::make_shared<Error>(std::move(error))) {}
  explicit operator bool() const { return value_ != nullptr; }
  const Value& value() const { return *value_; }
  const Error& error() const { return *error_; }

 private:
  std::shared_ptr<Value> value_;
  std::shared_ptr<Error> error_;
};

template <>
class [[nodiscard]] result<void> {
 public:
  result() = default;
  result(Error error) : error_(std::make_shared<Error>(std::move(error))) {}
  explicit operator bool() const { return error_ == nullptr; }
  const Error& error() const { return *error_; }

 private:
  std::shared_ptr<Error> error_;
};

}  // namespace Haptics
}  // namespace Ultraleap
