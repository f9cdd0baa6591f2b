# Completion of skillctl for bash 4 or newer, printed by `skillctl completion bash`.
_skillctl() {
    local line="${COMP_LINE:0:COMP_POINT}" IFS=$'\n' cut word
    local -a answer
    read -rd '' -a answer < <("$1" __complete line "$line" 2>/dev/null)
    # Bash ends words at = : and @, too, and replaces only the last piece, which is $2.
    word="${line##*[[:space:]]}" cut="${word%"$2"}"
    COMPREPLY=()
    for word in "${answer[@]:1}"; do
        word="${word%%$'\t'*}"
        COMPREPLY+=("${word#"$cut"}")
    done
    [[ ${#COMPREPLY[@]} -eq 1 && ${COMPREPLY[0]} == *[/=] ]] && compopt -o nospace
    case "${answer[0]}" in
        files*) compopt -o default ;;
        directories*) compopt -o dirnames ;;
    esac
    return 0
}
complete -F _skillctl skillctl
